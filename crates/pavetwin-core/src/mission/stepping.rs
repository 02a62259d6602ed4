//! One time step after the other, until something needs deciding.

use super::encounter::{Encounter, Ending, Situation, neighbours};
use super::error::FlightError;
use super::event::Event;
use super::flight::Flight;
use super::mode::Mode;
use super::reaction::{Progress, Reaction};
use super::task::Task;
use super::way_home::{self, WayHome};
use crate::geometry::wrap_angle;
use crate::navigation::Neighbour;

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
        let until_tick = self.clock.first_tick_at(until_s);
        if self.clock.tick == 0 {
            self.log_if_due(None);
        }
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(event);
            }
            let is_free = self.reaction.is_none() && self.encounter.is_none();
            if is_free && self.task.is_done(&self.uav, self.clock.tick) {
                self.inspection = None;
                self.task = Task::Idle;
                return Ok(Event::Arrived);
            }
            if self.clock.tick >= until_tick {
                return Ok(Event::Paused);
            }
            if self.clock.next_s() > self.trace.duration_s() {
                return Ok(Event::RecordingEnds);
            }
            self.step()?;
        }
    }

    fn step(&mut self) -> Result<(), FlightError> {
        let dt_s = self.clock.step_s;
        let before = self.uav;
        if !self.step_encounter(dt_s)? && !self.step_reaction(dt_s)? {
            self.step_task(dt_s)?;
        }
        self.clock.tick += 1;
        let moved = self.uav.position - before.position;
        let flown_m = moved.length();
        self.odometer_m += flown_m;
        let turned_rad = wrap_angle(self.uav.yaw_rad - before.yaw_rad);
        self.way_home.extend(flown_m, turned_rad, &self.settings.transit);
        if !self.mode.is_parked() {
            let climb_mps = (self.uav.altitude_m - before.altitude_m) / dt_s;
            let drained = self.settings.battery.drain.drained(moved * (1.0 / dt_s), climb_mps, dt_s);
            if !self.charge.drain(drained) {
                return Err(FlightError::BatteryEmpty { time_s: self.time_s() });
            }
        }
        self.look_if_due()?;
        self.weigh_way_home()
    }

    fn step_task(&mut self, dt_s: f64) -> Result<(), FlightError> {
        if self.inspection.is_some() && self.task.follower().is_some() {
            self.mode = Mode::Inspect; // after a reaction
        }
        let Self { ground, trace, settings, uav, task, clock, shared_airspace, .. } = self;
        if let Task::Steer(steering) = task {
            let time_s = clock.time_s();
            let near =
                if *shared_airspace { neighbours(trace, uav, settings.clearance_m, time_s)? } else { Vec::new() };
            steering.step(&ground.mesh, uav, settings, &near, dt_s);
            return Ok(());
        }
        if let Some(destination) = self.task.step(&mut self.uav, self.settings.climb_speed_mps, dt_s) {
            self.task = Task::to(&self.ground.mesh, &self.uav, destination, &self.settings)?;
        }
        Ok(())
    }

    /// One step of the reaction in progress; false when there is none and the task goes on.
    fn step_reaction(&mut self, dt_s: f64) -> Result<bool, FlightError> {
        let next_tick = self.clock.tick + 1;
        let airframe = (&self.ground.mesh, &self.settings.inspect);
        match self.reaction.step(&mut self.uav, &mut self.task, airframe, next_tick, dt_s)? {
            Progress::Inactive => return Ok(false),
            Progress::Displacing => {}
            Progress::Waiting { is_over } => {
                self.occlusions.waited_a_step();
                if let Some(inspection) = self.inspection.as_mut().filter(|_| is_over) {
                    inspection.look_at(next_tick);
                }
            }
            Progress::Displaced => {
                if let Some(inspection) = &mut self.inspection {
                    inspection.capture_at(next_tick);
                }
            }
            Progress::Returned => self.occlusions.end_displacement(self.odometer_m),
        }
        Ok(true)
    }

    /// One step of keeping clear; false when nothing is near and the task moves on as planned.
    fn step_encounter(&mut self, dt_s: f64) -> Result<bool, FlightError> {
        let cannot_avoid = matches!(self.task, Task::Idle | Task::Climb { .. } | Task::Halt { .. } | Task::Steer(_));
        if !self.shared_airspace || cannot_avoid || self.uav.altitude_m == 0.0 {
            return Ok(false);
        }
        let neighbours = neighbours(&self.trace, &self.uav, self.settings.clearance_m, self.time_s())?;
        let mut encounter = match self.encounter {
            Some(encounter) => encounter,
            None => {
                let begun = Encounter::begin(&self.situation(&neighbours), self.mode);
                let Some(begun) = begun else { return Ok(false) };
                if self.reaction.waits_until().is_none() {
                    self.reaction = Reaction::None; // a displacement is given up
                }
                self.mode = Mode::Avoid;
                begun
            }
        };
        let (position, ending) = encounter.step(&self.situation(&neighbours), dt_s);
        self.uav.position = position;
        self.uav.speed_mps = encounter.velocity_mps.length();
        self.encounter = Some(encounter);
        if let Some(ending) = ending {
            self.end_encounter(&encounter, ending, &neighbours)?;
        }
        Ok(true)
    }

    fn end_encounter(
        &mut self,
        encounter: &Encounter,
        ending: Ending,
        neighbours: &[Neighbour],
    ) -> Result<(), FlightError> {
        self.encounter = None;
        self.uav.speed_mps = 0.0;
        self.mode = if self.reaction.waits_until().is_some() { Mode::Wait } else { encounter.mode_before };
        match ending {
            Ending::Settled => self.task = Task::Stay { until_tick: self.clock.tick },
            Ending::GivenUp => self.report_low_battery(),
            Ending::Free => {
                if let Some(rest) = self.situation(neighbours).rest_of_route()? {
                    self.task = rest;
                }
            }
        }
        Ok(())
    }

    fn situation<'a>(&'a self, neighbours: &'a [Neighbour]) -> Situation<'a> {
        Situation {
            mesh: &self.ground.mesh,
            settings: &self.settings,
            uav: &self.uav,
            task: &self.task,
            waits_until: self.reaction.waits_until(),
            tick: self.clock.tick,
            neighbours,
        }
    }

    /// Reports `BatteryLow` when flying home now would leave no more than the reserve.
    fn weigh_way_home(&mut self) -> Result<(), FlightError> {
        let every = self.clock.ticks(way_home::CHECK_S).max(1);
        if self.heading_home || self.uav.altitude_m == 0.0 || !self.clock.tick.is_multiple_of(every) {
            return Ok(());
        }
        if self.can_go_on() {
            return Ok(());
        }
        let way = self.ground.mesh.path(self.uav.position, self.base)?;
        self.way_home = WayHome::along(&way, &self.settings.transit);
        if self.can_go_on() {
            return Ok(());
        }
        match &mut self.encounter {
            Some(encounter) => encounter.give_up(), // reported once the UAV has come to rest
            None => self.report_low_battery(),
        }
        Ok(())
    }

    fn can_go_on(&self) -> bool {
        let cost = self.way_home.cost(self.uav.altitude_m, &self.settings);
        self.charge.left - cost > self.settings.battery.reserve
    }

    fn report_low_battery(&mut self) {
        self.heading_home = true;
        self.events.push_back(Event::BatteryLow);
    }
}
