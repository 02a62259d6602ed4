//! Encounters: other agents at the UAV's own altitude, kept clear of by ORCA; afterwards the route is planned anew.

use super::course::{course, foot_on, rest_of};
use super::event::Event;
use super::flight::{Flight, FlightError, Mode, Task};
use super::reaction::Reaction;
use crate::geometry::Vec2;
use crate::navigation::{Avoider, Follower, Motion, Neighbour, Rail};
use crate::sensing::Trace;

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
/// An agent that reaches into the altitude ± this is at the UAV's own: the clearance of the flight domain.
const CLEARANCE_M: f64 = 1.0;
/// While avoiding, the UAV aims at the place this far ahead on its route.
const AIM_AHEAD_M: f64 = 6.0;
/// At this speed and this near to where it was to stay, the UAV counts as standing there.
const STANDING_MPS: f64 = 0.05;
const STANDING_M: f64 = 0.05;

/// In progress in place of the task's own movement.
#[derive(Debug, Clone, Copy)]
pub(super) struct Encounter {
    pub velocity_mps: Vec2,
    /// Where the UAV was to stay, when it was not under way.
    stay_at: Option<Vec2>,
    /// Nothing is in the way any more, or the battery is low, and the UAV comes to rest.
    is_over: bool,
    /// The battery is low: wherever the UAV was to stay, it must go home.
    gives_up: bool,
    /// Another stands where the route ends, and the UAV is as near as it can come: that counts as arrived.
    settles: bool,
}

/// Whether anything in the recording ever reaches the altitude: mostly nothing does, and no step need look.
pub(super) fn reaches(trace: &Trace, altitude_m: f64) -> bool {
    trace.bodies().iter().any(|body| body.height_m > altitude_m - CLEARANCE_M && body.base_m < altitude_m + CLEARANCE_M)
}

impl Flight {
    /// One step of keeping clear; false when nothing is near and the task moves on as planned.
    pub(super) fn step_encounter(&mut self, dt_s: f64) -> Result<bool, FlightError> {
        if !self.shared_airspace
            || matches!(self.task, Task::Idle | Task::Climb { .. } | Task::Halt { .. })
            || self.altitude_m == 0.0
        {
            return Ok(false);
        }
        let neighbours = self.neighbours()?;
        let Some(mut encounter) = self.encounter.or_else(|| self.begin_encounter(&neighbours)) else {
            return Ok(false);
        };
        encounter.settles = self.has_arrived(&neighbours);
        let is_free = self.has_waited() || !self.in_the_way(&neighbours, encounter.stay_at, ENDS_M);
        encounter.is_over = encounter.gives_up || encounter.settles || is_free;
        let preferred_mps = self.preferred(&encounter, &neighbours);
        let avoider = Avoider { radius_m: self.settings.radius_m, limits: self.settings.inspect };
        let (mesh, position) = (&self.ground.mesh, self.position);
        (self.position, _) = avoider.step(mesh, position, encounter.velocity_mps, preferred_mps, &neighbours, dt_s);
        encounter.velocity_mps = (self.position - position) * (1.0 / dt_s);
        self.speed_mps = encounter.velocity_mps.length();
        self.encounter = Some(encounter);
        if encounter.is_over && self.stands(&encounter) {
            self.end_encounter(&encounter)?;
        }
        Ok(true)
    }

    /// Gives up an encounter because the battery is low: the UAV comes to rest and then reports it.
    pub(super) fn give_up_encounter(&mut self) {
        if let Some(encounter) = &mut self.encounter {
            encounter.gives_up = true;
        }
    }

    fn begin_encounter(&mut self, neighbours: &[Neighbour]) -> Option<Encounter> {
        let waits = matches!(self.reaction, Reaction::Wait { .. });
        let stays = waits || !matches!(self.task, Task::Rail(_));
        if !self.in_the_way(neighbours, stays.then_some(self.position), BEGINS_M) {
            return None;
        }
        if !waits {
            self.reaction = Reaction::None; // a displacement is given up
        }
        let (velocity_mps, stay_at) = match &self.task {
            Task::Rail(follower) if !waits => (follower.velocity_mps(), None),
            Task::Rail(follower) => (follower.velocity_mps(), Some(self.position)),
            _ => (Vec2::ZERO, Some(self.position)),
        };
        self.mode_before = self.mode;
        self.mode = Mode::Avoid;
        Some(Encounter { velocity_mps, stay_at, is_over: false, gives_up: false, settles: false })
    }

    /// Whether another comes too near, should it and the UAV go on as they do: the UAV towards its place or along its
    /// route, at the speed it would have there.
    fn in_the_way(&self, neighbours: &[Neighbour], stay_at: Option<Vec2>, gap_m: f64) -> bool {
        let own_mps = self.towards(self.aim(stay_at));
        neighbours.iter().any(|neighbour| {
            let (offset, drift_mps) = (neighbour.position - self.position, neighbour.velocity_mps - own_mps);
            let meets_s = -offset.dot(drift_mps) / drift_mps.dot(drift_mps).max(f64::MIN_POSITIVE);
            let nearest = offset + drift_mps * meets_s.clamp(0.0, HORIZON_S);
            nearest.length() < self.settings.radius_m + neighbour.radius_m + gap_m
        })
    }

    /// Where the UAV would go if it were alone: along its route, back to where it was to stay, or to rest.
    fn preferred(&self, encounter: &Encounter, neighbours: &[Neighbour]) -> Vec2 {
        if encounter.is_over && (encounter.gives_up || encounter.settles || encounter.stay_at.is_none()) {
            return Vec2::ZERO;
        }
        let aim = self.aim(encounter.stay_at);
        self.towards(self.beside(aim, neighbours).unwrap_or(aim))
    }

    /// ORCA alone looks no farther than its next velocity, and would press past a standing agent on the side of a wall. So
    /// the place beside the first one that stands before the aim, to its right where the mesh has room, else to its left.
    fn beside(&self, aim: Vec2, neighbours: &[Neighbour]) -> Option<Vec2> {
        let ahead = (aim - self.position).normalized();
        let apart_m = |neighbour: &Neighbour| self.settings.radius_m + neighbour.radius_m;
        let blocks = |neighbour: &&Neighbour| {
            let foot = foot_on(&[self.position, aim], neighbour.position);
            neighbour.velocity_mps.length() < SLOW_MPS && foot.distance(neighbour.position) < apart_m(neighbour) + GAP_M
        };
        let distance = |neighbour: &&Neighbour| neighbour.position.distance(self.position);
        let first = neighbours.iter().filter(blocks).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let aside = ahead.left() * (apart_m(first) + 2.0 * GAP_M);
        [first.position - aside, first.position + aside]
            .into_iter()
            .find(|place| self.ground.mesh.segment_inside(self.position, *place))
    }

    /// The place to fly to next, in a straight line within the mesh: where the UAV was to stay, else on its route ahead.
    fn aim(&self, stay_at: Option<Vec2>) -> Vec2 {
        let goal = match (stay_at, &self.task) {
            (Some(place), _) => place,
            (None, Task::Rail(follower)) => ahead_on(follower.rail().points(), self.position),
            (None, _) => self.position,
        };
        if self.ground.mesh.segment_inside(self.position, goal) {
            return goal;
        }
        // Behind a corner: the first leg of the way there.
        self.ground.mesh.path(self.position, goal).map_or(self.position, |way| way[1])
    }

    /// The velocity towards a place: never faster than the UAV can brake by the time it is there.
    fn towards(&self, aim: Vec2) -> Vec2 {
        let (offset, limits) = (aim - self.position, self.settings.inspect);
        let speed_mps = (limits.acceleration_mps2 * offset.length()).sqrt().min(limits.speed_mps);
        offset.normalized() * speed_mps
    }

    fn stands(&self, encounter: &Encounter) -> bool {
        let is_there = |place: Vec2| place.distance(self.position) < STANDING_M;
        self.speed_mps < STANDING_MPS
            && (encounter.gives_up || encounter.settles || encounter.stay_at.is_none_or(is_there))
    }

    /// Plans the rest of the route from here, or reports the low battery.
    fn end_encounter(&mut self, encounter: &Encounter) -> Result<(), FlightError> {
        self.encounter = None;
        self.speed_mps = 0.0;
        self.mode = if matches!(self.reaction, Reaction::Wait { .. }) { Mode::Wait } else { self.mode_before };
        if encounter.settles {
            self.task = Task::Stay { until_tick: self.tick };
        } else if encounter.gives_up {
            self.heading_home = true;
            self.queue.push_back(Event::BatteryLow);
        } else if let Task::Rail(follower) = &self.task {
            let limits = follower.rail().limits();
            let rest = rest_of(follower.rail().points(), self.position);
            let way = course(&self.ground.mesh, self.position, &rest)?;
            let rail = Rail::new(&self.ground.mesh, &way, &limits)?;
            self.task = Task::Rail(Box::new(Follower::new(rail, self.yaw_rad)));
        }
        Ok(())
    }

    /// Whether the UAV is where the task was to bring it, or beside another that stands there, or has stayed its time.
    fn has_arrived(&self, neighbours: &[Neighbour]) -> bool {
        let goal = match &self.task {
            Task::Rail(follower) => follower.rail().points().last().copied(),
            Task::Stay { until_tick } => return self.tick >= *until_tick,
            _ => None,
        };
        let Some(goal) = goal else { return false };
        let left_m = goal.distance(self.position);
        let is_taken = |neighbour: &Neighbour| {
            let apart_m = self.settings.radius_m + neighbour.radius_m + GAP_M;
            neighbour.velocity_mps.length() < SLOW_MPS
                && neighbour.position.distance(goal) < apart_m
                && left_m < 2.0 * apart_m
        };
        left_m < ARRIVED_M || neighbours.iter().any(is_taken)
    }

    /// Whether the wait that a policy asked for has passed, so that it must be asked again.
    fn has_waited(&self) -> bool {
        matches!(self.reaction, Reaction::Wait { until_tick } if self.tick >= until_tick)
    }

    fn neighbours(&self) -> Result<Vec<Neighbour>, FlightError> {
        let mut neighbours = Vec::new();
        let (low_m, high_m) = (self.altitude_m - CLEARANCE_M, self.altitude_m + CLEARANCE_M);
        self.trace
            .agents_near(self.position, LOOK_M, self.time_s(), &mut |pose| {
                if pose.body.height_m > low_m && pose.body.base_m < high_m {
                    neighbours.push(Neighbour {
                        position: pose.position,
                        velocity_mps: pose.velocity,
                        radius_m: pose.body.half_diagonal_m(),
                    });
                }
            })
            .map_err(crate::sensing::SenseError::from)?;
        Ok(neighbours)
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
