//! A flight: its parts, and the commands it takes. The stepping is in `stepping`, the looking in `looking`.

use super::battery::Charge;
use super::clock::Clock;
use super::course::{course, rest_of, shortened};
use super::coverage::Coverage;
use super::displacement::DisplacementPredictor;
use super::encounter::{Encounter, shares_airspace};
use super::error::FlightError;
use super::event::Event;
use super::ground::Ground;
use super::inspection::Inspection;
use super::log::{Captures, Log, Track};
use super::mode::Mode;
use super::occlusions::Occlusions;
use super::reaction::Reaction;
use super::settings::Settings;
use super::steering::{Steer, Steering};
use super::task::{Destination, Moving, Task};
use super::uav::UavState;
use super::way_home::WayHome;
use crate::geometry::Vec2;
use crate::navigation::TurnTo;
use crate::sensing::{SenseError, Trace, Viewpoint};
use std::collections::VecDeque;
use std::sync::Arc;

/// One UAV over one ground in one recorded traffic.
#[derive(Debug)]
pub struct Flight {
    pub(super) ground: Arc<Ground>,
    pub(super) trace: Arc<Trace>,
    pub(super) settings: Settings,
    pub(super) base: Vec2,
    pub(super) clock: Clock,
    pub(super) uav: UavState,
    pub(super) charge: Charge,
    /// Flown over the ground since the beginning, metres.
    pub(super) odometer_m: f64,
    pub(super) mode: Mode,
    pub(super) task: Task,
    pub(super) reaction: Reaction,
    pub(super) encounter: Option<Encounter>,
    /// Whether any agent of the recording reaches the mission's altitude.
    pub(super) shared_airspace: bool,
    pub(super) inspection: Option<Inspection>,
    pub(super) occlusions: Occlusions,
    pub(super) coverage: Coverage,
    pub(super) way_home: WayHome,
    pub(super) heading_home: bool,
    pub(super) events: VecDeque<Event>,
    pub(super) log: Log,
}

impl Flight {
    /// On the ground at the base, at the beginning of the recording, with a full battery.
    ///
    /// # Errors
    /// When the settings do not describe a mission.
    pub fn new(ground: Arc<Ground>, trace: Arc<Trace>, settings: Settings, base: Vec2) -> Result<Self, FlightError> {
        settings.check()?;
        let base = ground.mesh.nearest(base);
        Ok(Self {
            base,
            clock: Clock::new(settings.time_step_s),
            uav: UavState::on_the_ground_at(base),
            charge: Charge::full(),
            odometer_m: 0.0,
            mode: Mode::Ground,
            task: Task::Idle,
            reaction: Reaction::None,
            encounter: None,
            shared_airspace: shares_airspace(&trace, &settings),
            inspection: None,
            occlusions: Occlusions::default(),
            coverage: Coverage::new(&ground),
            way_home: WayHome::default(),
            heading_home: false,
            events: VecDeque::new(),
            log: Log::default(),
            ground,
            trace,
            settings,
        })
    }

    /// Climbs or sinks to an altitude on the spot; 0 lands.
    pub fn climb_to(&mut self, altitude_m: f64) {
        let mode = if altitude_m < self.uav.altitude_m { Mode::Land } else { Mode::Climb };
        self.begin(mode, Task::Climb { to_m: altitude_m });
    }

    /// Flies to a place, or to the nearest one that can be reached, by the shortest way at transit speed, in mode
    /// transit, revisit or home. It stops on the spot, or with `stop_short` at the stopping distance before it. What is
    /// already moving comes to rest first.
    ///
    /// # Errors
    /// When the mesh has no way there, or it moves by hand.
    pub fn fly_to(&mut self, goal: Vec2, mode: Mode, stop_short: bool) -> Result<(), FlightError> {
        self.check_no_hand_moves()?;
        let then = Destination { goal, stop_short };
        let task = match self.moving() {
            Some(moving) => Task::Halt { moving, then },
            None => Task::to(&self.ground.mesh, &self.uav, then, &self.settings)?,
        };
        self.heading_home = mode == Mode::Home;
        self.begin(mode, task);
        Ok(())
    }

    /// The movement in progress; `None` at rest, and in an encounter, which leaves the line that could be braked along.
    fn moving(&self) -> Option<Moving> {
        if self.uav.speed_mps == 0.0 || self.encounter.is_some() {
            return None;
        }
        self.reaction.moving().or_else(|| self.task.moving())
    }

    /// Flies home, to the base.
    ///
    /// # Errors
    /// When the mesh has no way there.
    pub fn fly_home(&mut self) -> Result<(), FlightError> {
        self.fly_to(self.base, Mode::Home, false)
    }

    /// Turns on the spot.
    pub fn turn_to(&mut self, yaw_rad: f64) {
        let turn = TurnTo::new(self.uav.position, self.uav.yaw_rad, yaw_rad, &self.settings.inspect);
        self.begin(Mode::Transit, Task::Turn(turn));
    }

    /// Inspects a segment along a line, fitted into the mesh, ending at the stopping distance before the line's end.
    ///
    /// # Errors
    /// When there is no such segment, or nothing of the line can be reached.
    pub fn inspect(&mut self, segment: u32, line: &[Vec2]) -> Result<(), FlightError> {
        self.check_segment(segment)?;
        let mesh = &self.ground.mesh;
        let way = course(mesh, self.uav.position, line)?;
        let flown = shortened(&way, self.settings.stopping_distance_m);
        let task = Task::along(mesh, &self.uav, &flown, &self.settings.inspect)?;
        self.begin(Mode::Inspect, task);
        self.inspection = Some(Inspection::along(segment, way, self.clock.tick));
        Ok(())
    }

    /// Stays where it is and looks at a segment: a revisit.
    ///
    /// # Errors
    /// When there is no such segment.
    pub fn revisit(&mut self, segment: u32, stay_s: f64) -> Result<(), FlightError> {
        self.check_segment(segment)?;
        self.begin(Mode::Revisit, self.stay(stay_s));
        self.inspection = Some(Inspection::revisit(segment, self.clock.tick));
        Ok(())
    }

    /// Flies by hand until another command, and looks at a segment: at the velocities and the rate of turn that are asked
    /// for, within the limits of transit. Asked again it goes on with these, and with its looks at their intervals.
    ///
    /// # Errors
    /// When there is no such segment, or another command is still moving it.
    pub fn steer(&mut self, segment: u32, wanted: Steer) -> Result<(), FlightError> {
        self.check_segment(segment)?;
        if let (Task::Steer(steering), Some(inspection)) = (&mut self.task, &mut self.inspection) {
            steering.ask(wanted);
            if inspection.segment != segment {
                inspection.turn_to(segment);
                self.occlusions.end_episode();
            }
            return Ok(());
        }
        if self.uav.speed_mps > 0.0 {
            return Err(FlightError::StillMoving { speed_mps: self.uav.speed_mps });
        }
        self.begin(Mode::Inspect, Task::Steer(Steering::from_rest(wanted)));
        self.inspection = Some(Inspection::along(segment, Vec::new(), self.clock.tick));
        Ok(())
    }

    /// Stands on the ground until the battery has been swapped.
    pub fn swap_battery(&mut self, swap_s: f64) {
        self.begin(Mode::Swap, self.stay(swap_s));
        self.charge.swap();
        self.heading_home = false;
        self.way_home = WayHome::default();
    }

    /// Brakes and stays until `seconds` from now, then looks again.
    pub fn wait(&mut self, seconds: f64) {
        self.mode = Mode::Wait;
        self.reaction = Reaction::Wait { until_tick: self.clock.tick + self.clock.ticks(seconds).max(1) };
    }

    /// Brakes, moves aside without turning, stays, and comes back to where it came to rest. The displacement is cut
    /// where it would leave the mesh.
    pub fn displace(&mut self, displacement: Vec2, stay_s: f64) {
        self.mode = Mode::Displace;
        self.reaction = Reaction::Brake { displacement, stay_ticks: self.clock.ticks(stay_s) };
        self.occlusions.begin_displacement();
    }

    /// Goes on in a longer recording that begins with the present one.
    ///
    /// # Errors
    /// When it does not.
    pub fn extend(&mut self, trace: Arc<Trace>) -> Result<(), FlightError> {
        if !self.trace.is_prefix_of(&trace).map_err(SenseError::from)? {
            return Err(FlightError::OtherRecording);
        }
        self.shared_airspace = shares_airspace(&trace, &self.settings);
        self.trace = trace;
        Ok(())
    }

    fn begin(&mut self, mode: Mode, task: Task) {
        self.mode = mode;
        self.task = task;
        self.reaction = Reaction::None;
        self.encounter = None;
        self.inspection = None;
        self.occlusions.end_episode();
        self.events.clear();
    }

    fn stay(&self, seconds: f64) -> Task {
        Task::Stay { until_tick: self.clock.tick + self.clock.ticks(seconds) }
    }

    fn check_no_hand_moves(&self) -> Result<(), FlightError> {
        let speed_mps = self.uav.speed_mps;
        let is_moved = matches!(self.task, Task::Steer(_)) && speed_mps > 0.0;
        if is_moved { Err(FlightError::StillMoving { speed_mps }) } else { Ok(()) }
    }

    fn check_segment(&self, segment: u32) -> Result<(), FlightError> {
        let segments = self.ground.segments.len();
        if (segment as usize) < segments { Ok(()) } else { Err(FlightError::UnknownSegment { segment, segments }) }
    }

    /// What is left of the line under inspection, from where the UAV is; empty when it flies none.
    pub fn remaining(&self) -> Vec<Vec2> {
        match (&self.inspection, &self.task) {
            (Some(inspection), Task::Rail(_)) => rest_of(&inspection.line, self.uav.position),
            _ => Vec::new(),
        }
    }

    /// What predicts visibility from the present state; `None` when nothing is under inspection.
    pub fn predictor(&self) -> Option<DisplacementPredictor> {
        let inspection = self.inspection.as_ref()?;
        let (speed_mps, limits) = (self.uav.speed_mps, self.settings.inspect);
        let rest = self.task.follower().map_or(self.uav.position, |follower| {
            let brake_m = speed_mps * speed_mps / (2.0 * limits.acceleration_mps2);
            follower.rail().sample(follower.s_m() + brake_m).0
        });
        Some(DisplacementPredictor {
            ground: self.ground.clone(),
            trace: self.trace.clone(),
            camera: self.settings.camera,
            limits,
            viewpoint: self.viewpoint(),
            rest,
            speed_mps,
            segment: inspection.segment,
            time_s: self.time_s(),
        })
    }

    pub fn time_s(&self) -> f64 {
        self.clock.time_s()
    }

    pub fn viewpoint(&self) -> Viewpoint {
        self.uav.viewpoint()
    }

    pub fn speed_mps(&self) -> f64 {
        self.uav.speed_mps
    }

    /// Over the ground.
    pub fn velocity_mps(&self) -> Vec2 {
        let avoiding = self.encounter.map(|encounter| encounter.velocity_mps);
        avoiding.or_else(|| self.reaction.velocity_mps()).unwrap_or_else(|| self.task.velocity_mps())
    }

    /// e, what is left of the battery.
    pub fn battery(&self) -> f64 {
        self.charge.left
    }

    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Share of a battery drained since the beginning, over all swaps.
    pub fn energy_used(&self) -> f64 {
        self.charge.used
    }

    /// Flown over the ground since the beginning, metres.
    pub fn distance_m(&self) -> f64 {
        self.odometer_m
    }

    /// Time spent waiting for a policy since the beginning.
    pub fn waited_s(&self) -> f64 {
        self.clock.seconds(self.occlusions.waited_ticks)
    }

    /// Episodes of occlusion since the beginning.
    pub fn occlusions(&self) -> u32 {
        self.occlusions.count
    }

    /// Share of a segment's cells seen so far.
    pub fn surface_coverage(&self, segment: u32) -> f64 {
        self.coverage.of_surface(&self.ground, segment)
    }

    /// Whether a defect's centre has been in the moving inspection window.
    pub fn swept(&self) -> &[bool] {
        self.coverage.swept()
    }

    /// Whether captures should still report a defect.
    pub fn set_wanted(&mut self, defect: u32, wanted: bool) {
        self.coverage.set_wanted(defect, wanted);
    }

    pub fn track(&self) -> &Track {
        &self.log.track
    }

    pub fn captures(&self) -> &Captures {
        &self.log.captures
    }
}
