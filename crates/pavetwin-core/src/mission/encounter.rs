//! Encounters: other agents at the UAV's own altitude, kept clear of by ORCA; afterwards the route is planned again.

use super::course::{course, foot_on, rest_of};
use super::error::FlightError;
use super::mode::Mode;
use super::settings::Settings;
use super::task::Task;
use super::uav::UavState;
use crate::geometry::Vec2;
use crate::navigation::{Avoider, Motion, NavMesh, Neighbour};
use crate::sensing::{SenseError, Trace};

/// How far around the UAV others are looked for, metres: two that close in at 12 m/s meet after `HORIZON_S`.
const LOOK_M: f64 = 60.0;
/// How far ahead courses are compared, seconds.
const HORIZON_S: f64 = 5.0;
/// An encounter begins when the two bodies would come nearer than this to each other, metres.
const BEGINS_M: f64 = 1.0;
/// And ends when they would not come nearer than this.
const ENDS_M: f64 = 2.0;
/// An agent slower than this counts as standing.
const SLOW_MPS: f64 = 1.0;
/// As near to the end of its route the UAV counts as arrived, metres: while avoiding it comes no nearer for certain.
const ARRIVED_M: f64 = 0.5;
/// Kept to a standing agent on the way past it, metres from body to body.
const GAP_M: f64 = 0.5;
/// While avoiding, the UAV aims at the place this far ahead on its route.
const AIM_AHEAD_M: f64 = 6.0;
/// At this speed and this near to where it was to stay, the UAV counts as standing there.
const STANDING_MPS: f64 = 0.05;
const STANDING_M: f64 = 0.05;

/// Whether anything in the recording ever reaches the UAV's altitude: mostly nothing does, and no step need look.
pub(super) fn shares_airspace(trace: &Trace, settings: &Settings) -> bool {
    let (low_m, high_m) = (settings.altitude_m - settings.clearance_m, settings.altitude_m + settings.clearance_m);
    trace.bodies().iter().any(|body| body.height_m > low_m && body.base_m < high_m)
}

/// The agents around the UAV at its present altitude.
pub(super) fn neighbours(
    trace: &Trace,
    uav: &UavState,
    clearance_m: f64,
    time_s: f64,
) -> Result<Vec<Neighbour>, FlightError> {
    let mut neighbours = Vec::new();
    let (low_m, high_m) = (uav.altitude_m - clearance_m, uav.altitude_m + clearance_m);
    trace
        .agents_near(uav.position, LOOK_M, time_s, &mut |pose| {
            if pose.body.height_m > low_m && pose.body.base_m < high_m {
                neighbours.push(Neighbour {
                    position: pose.position,
                    velocity_mps: pose.velocity,
                    radius_m: pose.body.half_diagonal_m(),
                });
            }
        })
        .map_err(SenseError::from)?;
    Ok(neighbours)
}

/// What an encounter is decided by: the flight as it stands, and who else is there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Situation<'a> {
    pub mesh: &'a NavMesh,
    pub settings: &'a Settings,
    pub uav: &'a UavState,
    pub task: &'a Task,
    /// When the wait that a policy asked for is over; `None` when it asked for none.
    pub waits_until: Option<u64>,
    pub tick: u64,
    pub neighbours: &'a [Neighbour],
}

/// In progress in place of the task's own movement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Encounter {
    pub velocity_mps: Vec2,
    /// The mode that it interrupted.
    pub mode_before: Mode,
    /// Where the UAV was to stay, when it was not under way.
    stay_at: Option<Vec2>,
    /// The battery is low: wherever the UAV was to stay, it must go home.
    gives_up: bool,
}

/// How an encounter ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ending {
    /// Nothing is in the way any more: the rest of the route is planned from here.
    Free,
    /// Another stands where the route ends, and the UAV is as near as it can come: that counts as arrived.
    Settled,
    /// The UAV has come to rest because the battery is low.
    GivenUp,
}

impl Encounter {
    /// Begins when another comes too near.
    pub fn begin(situation: &Situation, mode_before: Mode) -> Option<Self> {
        let position = situation.uav.position;
        let route = situation.task.follower().filter(|_| situation.waits_until.is_none());
        let stay_at = if route.is_some() { None } else { Some(position) };
        if !situation.in_the_way(stay_at, BEGINS_M) {
            return None;
        }
        let velocity_mps = situation.task.follower().map_or(Vec2::ZERO, Motion::velocity_mps);
        Some(Self { velocity_mps, mode_before, stay_at, gives_up: false })
    }

    /// The UAV is to come to rest, because the battery is low.
    pub fn give_up(&mut self) {
        self.gives_up = true;
    }

    /// One time step: where the UAV then is, and how the encounter ends if it does.
    pub fn step(&mut self, situation: &Situation, dt_s: f64) -> (Vec2, Option<Ending>) {
        let ending = if situation.has_arrived() {
            Some(Ending::Settled)
        } else if self.gives_up {
            Some(Ending::GivenUp)
        } else if situation.has_waited() || !situation.in_the_way(self.stay_at, ENDS_M) {
            Some(Ending::Free)
        } else {
            None
        };
        let preferred_mps = self.preferred(situation, ending);
        let Situation { mesh, settings, uav, neighbours, .. } = situation;
        let avoider = Avoider { radius_m: settings.radius_m, limits: settings.inspect };
        let (position, _) = avoider.step(mesh, uav.position, self.velocity_mps, preferred_mps, neighbours, dt_s);
        self.velocity_mps = (position - uav.position) * (1.0 / dt_s);
        (position, ending.filter(|ending| self.stands(position, *ending)))
    }

    /// Where the UAV would go if it were alone: along its route, back to where it was to stay, or to rest.
    fn preferred(&self, situation: &Situation, ending: Option<Ending>) -> Vec2 {
        match (ending, self.stay_at) {
            (Some(Ending::Settled | Ending::GivenUp), _) | (Some(Ending::Free), None) => return Vec2::ZERO,
            _ => {}
        }
        let aim = situation.aim(self.stay_at);
        situation.towards(situation.beside(aim).unwrap_or(aim))
    }

    fn stands(&self, position: Vec2, ending: Ending) -> bool {
        let is_there = |place: Vec2| place.distance(position) < STANDING_M;
        self.velocity_mps.length() < STANDING_MPS && (ending != Ending::Free || self.stay_at.is_none_or(is_there))
    }
}

impl Situation<'_> {
    /// Whether another comes too near, should it and the UAV go on as they do: the UAV towards its place or along its
    /// route, at the speed it would have there.
    fn in_the_way(&self, stay_at: Option<Vec2>, gap_m: f64) -> bool {
        let own_mps = self.towards(self.aim(stay_at));
        self.neighbours.iter().any(|neighbour| {
            let (offset, drift_mps) = (neighbour.position - self.uav.position, neighbour.velocity_mps - own_mps);
            let meets_s = -offset.dot(drift_mps) / drift_mps.dot(drift_mps).max(f64::MIN_POSITIVE);
            let nearest = offset + drift_mps * meets_s.clamp(0.0, HORIZON_S);
            nearest.length() < self.settings.radius_m + neighbour.radius_m + gap_m
        })
    }

    /// The place to fly to next, in a straight line within the mesh: where the UAV was to stay, else on its route
    /// ahead.
    fn aim(&self, stay_at: Option<Vec2>) -> Vec2 {
        let position = self.uav.position;
        let goal = stay_at.unwrap_or_else(|| {
            self.task.follower().map_or(position, |follower| ahead_on(follower.rail().points(), position))
        });
        if self.mesh.segment_inside(position, goal) {
            return goal;
        }
        // Behind a corner: the first leg of the way there.
        self.mesh.path(position, goal).map_or(position, |way| way[1])
    }

    /// The velocity towards a place: never faster than the UAV can brake by the time it is there.
    fn towards(&self, aim: Vec2) -> Vec2 {
        let (offset, limits) = (aim - self.uav.position, self.settings.inspect);
        let speed_mps = (limits.acceleration_mps2 * offset.length()).sqrt().min(limits.speed_mps);
        offset.normalized() * speed_mps
    }

    /// ORCA alone looks no farther than its next velocity, and would press past a standing agent on the side of a wall.
    /// So the place beside the first one that stands before the aim, to its right where the mesh has room, else to its
    /// left.
    fn beside(&self, aim: Vec2) -> Option<Vec2> {
        let position = self.uav.position;
        let ahead = (aim - position).normalized();
        let apart_m = |neighbour: &Neighbour| self.settings.radius_m + neighbour.radius_m;
        let blocks = |neighbour: &&Neighbour| {
            let foot = foot_on(&[position, aim], neighbour.position);
            neighbour.velocity_mps.length() < SLOW_MPS && foot.distance(neighbour.position) < apart_m(neighbour) + GAP_M
        };
        let distance = |neighbour: &&Neighbour| neighbour.position.distance(position);
        let blocking = self.neighbours.iter().filter(blocks);
        let first = blocking.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let aside = ahead.left() * (apart_m(first) + 2.0 * GAP_M);
        [first.position - aside, first.position + aside]
            .into_iter()
            .find(|place| self.mesh.segment_inside(position, *place))
    }

    /// Whether the UAV is where the task was to bring it, or beside another that stands there, or has stayed its time.
    fn has_arrived(&self) -> bool {
        let goal = match self.task {
            Task::Rail(follower) => follower.rail().points().last().copied(),
            Task::Stay { until_tick } => return self.tick >= *until_tick,
            _ => None,
        };
        let Some(goal) = goal else { return false };
        let left_m = goal.distance(self.uav.position);
        let is_taken = |neighbour: &Neighbour| {
            let apart_m = self.settings.radius_m + neighbour.radius_m + GAP_M;
            neighbour.velocity_mps.length() < SLOW_MPS
                && neighbour.position.distance(goal) < apart_m
                && left_m < 2.0 * apart_m
        };
        left_m < ARRIVED_M || self.neighbours.iter().any(is_taken)
    }

    /// Whether the wait that a policy asked for has passed, so that it must be asked again.
    fn has_waited(&self) -> bool {
        self.waits_until.is_some_and(|until_tick| self.tick >= until_tick)
    }

    /// The rest of the route, planned from where the UAV is; `None` when it flies none.
    pub fn rest_of_route(&self) -> Result<Option<Task>, FlightError> {
        let Some(follower) = self.task.follower() else { return Ok(None) };
        let rest = rest_of(follower.rail().points(), self.uav.position);
        let way = course(self.mesh, self.uav.position, &rest)?;
        Task::along(self.mesh, self.uav, &way, &follower.rail().limits()).map(Some)
    }
}

/// The point of a path that lies `AIM_AHEAD_M` beyond the one nearest to `position`.
fn ahead_on(path: &[Vec2], position: Vec2) -> Vec2 {
    let rest = rest_of(path, position);
    let mut left_m = AIM_AHEAD_M;
    for leg in rest.windows(2) {
        let leg_m = leg[0].distance(leg[1]);
        if leg_m >= left_m {
            return leg[0].lerp(leg[1], left_m / leg_m);
        }
        left_m -= leg_m;
    }
    rest.last().copied().unwrap_or(position)
}
