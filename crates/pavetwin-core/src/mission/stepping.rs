//! The clock: one time step after the other, until something needs deciding.

use super::event::Event;
use super::flight::{Flight, FlightError, Mode, Task};
use super::reaction::Reaction;
use crate::geometry::{Vec2, wrap_angle};
use crate::navigation::Motion;
use std::f64::consts::PI;

/// How often the way home is weighed, seconds.
const HOME_CHECK_S: f64 = 1.0;

/// Coming to rest, setting off for home and braking there, seconds of flight; turning comes on top.
const HOME_MANOEUVRES_S: f64 = 8.0;

/// What turning costs on top of the turn itself: slowing down before it and speeding up after it.
const TURN_ALLOWANCE: f64 = 2.0;

/// A moment this little after a time step, in steps, is that step.
const SAME_STEP: f64 = 1.0e-6;

impl Flight {
    /// Runs to the next event.
    ///
    /// # Errors
    /// When the battery runs empty.
    pub fn advance(&mut self) -> Result<Event, FlightError> {
        self.advance_until(f64::INFINITY)
    }

    /// Runs to the next event, or to the first time step at or after `until_s`. What happens afterwards does not depend
    /// on such pauses.
    ///
    /// # Errors
    /// When the battery runs empty.
    pub fn advance_until(&mut self, until_s: f64) -> Result<Event, FlightError> {
        let until_tick = (until_s / self.settings.time_step_s - SAME_STEP).ceil().max(0.0) as u64;
        if self.tick == 0 {
            self.log_if_due(None);
        }
        loop {
            if let Some(event) = self.queue.pop_front() {
                return Ok(event);
            }
            if matches!(self.reaction, Reaction::None) && self.encounter.is_none() && self.task_done() {
                self.inspection = None;
                self.task = Task::Idle;
                return Ok(Event::Arrived);
            }
            if self.tick >= until_tick {
                return Ok(Event::Paused);
            }
            let next_s = (self.tick + 1) as f64 * self.settings.time_step_s;
            if next_s > self.trace.duration_s() {
                return Ok(Event::RecordingEnds);
            }
            self.step()?;
        }
    }

    fn task_done(&self) -> bool {
        match &self.task {
            Task::Idle => true,
            Task::Climb { to_m } => self.altitude_m == *to_m,
            Task::Rail(follower) => follower.arrived(),
            Task::Turn(turn) => turn.arrived(),
            Task::Stay { until_tick } => self.tick >= *until_tick,
            Task::Halt { .. } => false,
        }
    }

    fn step(&mut self) -> Result<(), FlightError> {
        let dt_s = self.settings.time_step_s;
        let (position, altitude_m, yaw_rad) = (self.position, self.altitude_m, self.yaw_rad);
        if !self.step_encounter(dt_s)? && !self.step_reaction(dt_s)? {
            self.step_task(dt_s)?;
        }
        self.tick += 1;
        let moved = self.position - position;
        self.distance_m += moved.length();
        self.home_bound_m += moved.length();
        self.home_turns_s += TURN_ALLOWANCE * self.turn_s(wrap_angle(self.yaw_rad - yaw_rad));
        if !matches!(self.mode, Mode::Ground | Mode::Swap) {
            let climb_mps = (self.altitude_m - altitude_m) / dt_s;
            let drained = self.settings.drain.drained(moved * (1.0 / dt_s), climb_mps, dt_s);
            self.energy_used += drained;
            self.battery -= drained;
            if self.battery <= 0.0 {
                return Err(FlightError::BatteryEmpty { time_s: self.time_s() });
            }
        }
        self.look_if_due()?;
        self.weigh_way_home()
    }

    fn step_task(&mut self, dt_s: f64) -> Result<(), FlightError> {
        match &mut self.task {
            Task::Idle | Task::Stay { .. } => self.speed_mps = 0.0,
            Task::Climb { to_m } => {
                let most_m = self.settings.climb_speed_mps * dt_s;
                self.altitude_m += (*to_m - self.altitude_m).clamp(-most_m, most_m);
                self.speed_mps = 0.0;
            }
            Task::Turn(turn) => {
                turn.step(dt_s);
                self.yaw_rad = turn.yaw_rad();
                self.speed_mps = 0.0;
            }
            Task::Rail(follower) => {
                if self.inspection.is_some() {
                    self.mode = Mode::Inspect; // after a reaction
                }
                follower.resume();
                follower.step(dt_s);
                self.position = follower.position();
                self.yaw_rad = follower.yaw_rad();
                self.speed_mps = follower.speed_mps();
            }
            Task::Halt { moving, goal, stop_short } => {
                let (goal, stop_short, motion) = (*goal, *stop_short, moving.motion());
                motion.brake();
                motion.step(dt_s);
                (self.position, self.yaw_rad, self.speed_mps) =
                    (motion.position(), motion.yaw_rad(), motion.speed_mps());
                if self.speed_mps == 0.0 {
                    self.task = self.way_to(goal, stop_short)?;
                }
            }
        }
        Ok(())
    }

    pub(super) fn take_pose(&mut self, motion: &impl Motion) {
        self.position = motion.position();
        self.yaw_rad = motion.yaw_rad();
        self.speed_mps = motion.speed_mps();
    }

    fn turn_s(&self, turned_rad: f64) -> f64 {
        turned_rad.abs() / self.settings.transit.yaw_rate_rad_s
    }

    /// Reports `BatteryLow` when flying home now would leave no more than the reserve. Distance and turns home are bounded
    /// by those last measured and what was flown since, so that the mesh is searched only when that bound says so.
    fn weigh_way_home(&mut self) -> Result<(), FlightError> {
        let every = self.ticks(HOME_CHECK_S).max(1);
        if self.heading_home || self.altitude_m == 0.0 || !self.tick.is_multiple_of(every) {
            return Ok(());
        }
        if self.battery - self.cost_home() > self.settings.reserve {
            return Ok(());
        }
        let way = self.ground.mesh.path(self.position, self.base)?;
        self.home_bound_m = way.windows(2).map(|leg| leg[0].distance(leg[1])).sum();
        self.home_turns_s = self.corners_s(&way);
        if self.battery - self.cost_home() > self.settings.reserve {
            return Ok(());
        }
        if self.encounter.is_some() {
            self.give_up_encounter(); // which reports it once the UAV has come to rest
        } else {
            self.heading_home = true;
            self.queue.push_back(Event::BatteryLow);
        }
        Ok(())
    }

    /// What the corners of a way cost in time: at each the UAV may have to stop, turn and set off again.
    fn corners_s(&self, way: &[Vec2]) -> f64 {
        let stop_s = self.settings.transit.speed_mps / self.settings.transit.acceleration_mps2;
        let corner_s = |corner: &[Vec2]| {
            let (before, after) = (corner[1] - corner[0], corner[2] - corner[1]);
            stop_s + self.turn_s(before.cross(after).atan2(before.dot(after)))
        };
        way.windows(3).map(corner_s).sum()
    }

    fn cost_home(&self) -> f64 {
        let Self { settings, altitude_m, home_bound_m, home_turns_s, .. } = self;
        settings.drain.home(
            *home_bound_m,
            settings.transit.speed_mps,
            *altitude_m,
            settings.climb_speed_mps,
            HOME_MANOEUVRES_S + self.turn_s(PI) + home_turns_s,
        )
    }
}
