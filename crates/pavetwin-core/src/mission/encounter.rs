//! Encounters: other agents at the UAV's own altitude, kept clear of by ORCA; afterwards the route is planned anew.

use super::course::{course, rest_of};
use super::flight::{Flight, FlightError, Mode, Task};
use super::reaction::Reaction;
use crate::geometry::Vec2;
use crate::navigation::{Avoider, Follower, Motion, Neighbour, Rail};
use crate::sensing::Trace;

/// An encounter begins when another agent is this near, metres from centre to centre.
const BEGINS_M: f64 = 20.0;
/// And ends when none is nearer than this.
const ENDS_M: f64 = 25.0;
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
    velocity_mps: Vec2,
    /// Where the UAV was to stay, when it was not under way.
    stay_at: Option<Vec2>,
    /// No other agent is near any more, and the UAV comes to rest.
    is_over: bool,
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
        encounter.is_over = neighbours.is_empty();
        let preferred_mps = self.preferred(&encounter);
        let avoider = Avoider { radius_m: self.settings.radius_m, limits: self.settings.inspect };
        let (position, velocity_mps) =
            avoider.step(&self.ground.mesh, self.position, encounter.velocity_mps, preferred_mps, &neighbours, dt_s);
        self.position = position;
        self.speed_mps = velocity_mps.length();
        encounter.velocity_mps = velocity_mps;
        self.encounter = Some(encounter);
        if encounter.is_over && self.stands(&encounter) {
            self.end_encounter()?;
        }
        Ok(true)
    }

    fn begin_encounter(&mut self, neighbours: &[Neighbour]) -> Option<Encounter> {
        let is_near = |neighbour: &Neighbour| neighbour.position.distance(self.position) < BEGINS_M;
        if !neighbours.iter().any(is_near) {
            return None;
        }
        let waits = matches!(self.reaction, Reaction::Wait { .. });
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
        Some(Encounter { velocity_mps, stay_at, is_over: false })
    }

    /// Where the UAV would go if it were alone: along its route, back to where it was to stay, or to rest.
    fn preferred(&self, encounter: &Encounter) -> Vec2 {
        let aim = match (encounter.stay_at, &self.task) {
            (Some(place), _) => place,
            (None, _) if encounter.is_over => return Vec2::ZERO,
            (None, Task::Rail(follower)) => ahead_on(follower.rail().points(), self.position),
            (None, _) => self.position,
        };
        let (offset, limits) = (aim - self.position, self.settings.inspect);
        // Never faster than it can brake by the time it is there.
        let speed_mps = (2.0 * limits.acceleration_mps2 * offset.length() * 0.5).sqrt().min(limits.speed_mps);
        offset.normalized() * speed_mps
    }

    fn stands(&self, encounter: &Encounter) -> bool {
        self.speed_mps < STANDING_MPS
            && encounter.stay_at.is_none_or(|place| place.distance(self.position) < STANDING_M)
    }

    /// Plans the rest of the route from here.
    fn end_encounter(&mut self) -> Result<(), FlightError> {
        self.encounter = None;
        self.speed_mps = 0.0;
        self.mode = if matches!(self.reaction, Reaction::Wait { .. }) { Mode::Wait } else { self.mode_before };
        if let Task::Rail(follower) = &self.task {
            let limits = follower.rail().limits();
            let rest = rest_of(follower.rail().points(), self.position);
            let way = course(&self.ground.mesh, self.position, &rest)?;
            let rail = Rail::new(&self.ground.mesh, &way, &limits)?;
            self.task = Task::Rail(Box::new(Follower::new(rail, self.yaw_rad)));
        }
        Ok(())
    }

    fn neighbours(&self) -> Result<Vec<Neighbour>, FlightError> {
        let mut neighbours = Vec::new();
        let (low_m, high_m) = (self.altitude_m - CLEARANCE_M, self.altitude_m + CLEARANCE_M);
        self.trace
            .agents_near(self.position, ENDS_M, self.time_s(), &mut |pose| {
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
