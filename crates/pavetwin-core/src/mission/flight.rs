//! A flight: its state, and the commands it takes. The stepping is in `stepping`, the looking in `looking`.

use super::course::{course, nearest_reachable, rest_of, shortened};
use super::encounter::{Encounter, reaches};
use super::event::Event;
use super::ground::Ground;
use super::log::{Captures, Track};
use super::looking::Inspection;
use super::moment::Moment;
use super::reaction::{Episode, Reaction};
use super::settings::{Settings, SettingsError};
use crate::geometry::Vec2;
use crate::navigation::{Follower, Motion, NavMeshError, Rail, Strafe, TurnTo};
use crate::sensing::{CellSet, Observer, SenseError, Trace, Viewpoint};
use std::collections::VecDeque;
use std::sync::Arc;

/// What the UAV is doing, as the track records it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Mode {
    Ground = 0,
    Climb = 1,
    Transit = 2,
    Inspect = 3,
    Wait = 4,
    Displace = 5,
    Revisit = 6,
    Home = 7,
    Land = 8,
    Swap = 9,
    Avoid = 10,
}

/// Why a command or a step fails.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FlightError {
    #[error(transparent)]
    Settings(#[from] SettingsError),
    #[error(transparent)]
    NavMesh(#[from] NavMeshError),
    #[error(transparent)]
    Sense(#[from] SenseError),
    #[error("there is no segment {segment}; the ground has {segments}")]
    UnknownSegment { segment: u32, segments: usize },
    #[error("the battery ran empty after {time_s:.0} s in the air; raise energy.reserve or shorten the way")]
    BatteryEmpty { time_s: f64 },
    #[error("the extended recording does not begin with the present one")]
    OtherRecording,
}

/// The command in progress.
#[derive(Debug, Clone)]
pub(super) enum Task {
    Idle,
    Climb {
        to_m: f64,
    },
    Rail(Box<Follower>),
    Turn(TurnTo),
    Stay {
        until_tick: u64,
    },
    /// Comes to rest first, then flies to the goal.
    Halt {
        moving: Moving,
        goal: Vec2,
        stop_short: bool,
    },
}

/// A movement that a command cuts short.
#[derive(Debug, Clone)]
pub(super) enum Moving {
    Rail(Box<Follower>),
    Strafe(Strafe),
}

impl Moving {
    pub(super) fn motion(&mut self) -> &mut dyn Motion {
        match self {
            Self::Rail(follower) => &mut **follower,
            Self::Strafe(strafe) => strafe,
        }
    }

    fn velocity_mps(&self) -> Vec2 {
        match self {
            Self::Rail(follower) => follower.velocity_mps(),
            Self::Strafe(strafe) => strafe.velocity_mps(),
        }
    }
}

/// One UAV over one ground in one recorded traffic.
#[derive(Debug)]
pub struct Flight {
    pub(super) ground: Arc<Ground>,
    pub(super) trace: Arc<Trace>,
    pub(super) settings: Settings,
    pub(super) base: Vec2,
    pub(super) tick: u64,
    pub(super) position: Vec2,
    pub(super) altitude_m: f64,
    pub(super) yaw_rad: f64,
    pub(super) speed_mps: f64,
    pub(super) battery: f64,
    pub(super) energy_used: f64,
    pub(super) distance_m: f64,
    pub(super) waited_ticks: u64,
    pub(super) occlusions: u32,
    /// Never less than the distance home.
    pub(super) home_bound_m: f64,
    /// Never much less than the time that the corners on the way home cost.
    pub(super) home_turns_s: f64,
    pub(super) heading_home: bool,
    pub(super) mode: Mode,
    pub(super) task: Task,
    pub(super) reaction: Reaction,
    pub(super) encounter: Option<Encounter>,
    /// Whether any agent of the recording reaches the mission's altitude.
    pub(super) shared_airspace: bool,
    /// The mode that an encounter interrupted.
    pub(super) mode_before: Mode,
    pub(super) episode: Option<Episode>,
    pub(super) inspection: Option<Inspection>,
    /// The corners of the line under inspection, up to its end.
    pub(super) course: Vec<Vec2>,
    pub(super) observer: Observer,
    pub(super) seen: Vec<Option<CellSet>>,
    pub(super) wanted: Vec<bool>,
    pub(super) swept: Vec<bool>,
    pub(super) queue: VecDeque<Event>,
    pub(super) next_log_tick: u64,
    pub(super) track: Track,
    pub(super) captures: Captures,
}

impl Flight {
    /// On the ground at the base, at the beginning of the recording, with a full battery.
    ///
    /// # Errors
    /// When the settings do not describe a mission.
    pub fn new(ground: Arc<Ground>, trace: Arc<Trace>, settings: Settings, base: Vec2) -> Result<Self, FlightError> {
        settings.check()?;
        let base = ground.mesh.nearest(base);
        let shared_airspace = reaches(&trace, settings.altitude_m);
        let (segments, defects) = (ground.segments.len(), ground.defects.len());
        Ok(Self {
            ground,
            trace,
            settings,
            base,
            tick: 0,
            position: base,
            altitude_m: 0.0,
            yaw_rad: 0.0,
            speed_mps: 0.0,
            battery: 1.0,
            energy_used: 0.0,
            distance_m: 0.0,
            waited_ticks: 0,
            occlusions: 0,
            home_bound_m: 0.0,
            home_turns_s: 0.0,
            heading_home: false,
            mode: Mode::Ground,
            task: Task::Idle,
            reaction: Reaction::None,
            encounter: None,
            shared_airspace,
            mode_before: Mode::Ground,
            episode: None,
            inspection: None,
            course: Vec::new(),
            observer: Observer::new(),
            seen: vec![None; segments],
            wanted: vec![true; defects],
            swept: vec![false; defects],
            queue: VecDeque::new(),
            next_log_tick: 0,
            track: Track::default(),
            captures: Captures::default(),
        })
    }

    /// Climbs or sinks to an altitude on the spot; 0 lands.
    pub fn climb_to(&mut self, altitude_m: f64) {
        let mode = if altitude_m < self.altitude_m { Mode::Land } else { Mode::Climb };
        self.begin(mode, Task::Climb { to_m: altitude_m });
    }

    /// Flies to a place, or to the nearest one that can be reached, by the shortest way at transit speed, in mode
    /// transit, revisit or home. It stops on the spot, or with `stop_short` at the stopping distance before it. What is
    /// already moving comes to rest first.
    ///
    /// # Errors
    /// When the mesh has no way there.
    pub fn fly_to(&mut self, goal: Vec2, mode: Mode, stop_short: bool) -> Result<(), FlightError> {
        let task = match self.moving() {
            Some(moving) => Task::Halt { moving, goal, stop_short },
            None => self.way_to(goal, stop_short)?,
        };
        self.heading_home = mode == Mode::Home;
        self.begin(mode, task);
        Ok(())
    }

    /// The flight to a place, from rest.
    pub(super) fn way_to(&self, goal: Vec2, stop_short: bool) -> Result<Task, FlightError> {
        let mesh = &self.ground.mesh;
        let way = mesh.path(self.position, nearest_reachable(mesh, self.position, goal))?;
        let way = if stop_short { shortened(&way, self.settings.stopping_distance_m) } else { way };
        let rail = Rail::new(mesh, &way, &self.settings.transit)?;
        Ok(Task::Rail(Box::new(Follower::new(rail, self.yaw_rad))))
    }

    /// The movement in progress; `None` at rest, and in an encounter, which leaves the line that could be braked along.
    fn moving(&self) -> Option<Moving> {
        match (&self.reaction, &self.task) {
            _ if self.speed_mps == 0.0 || self.encounter.is_some() => None,
            (Reaction::Out { strafe, .. } | Reaction::Back { strafe }, _) => Some(Moving::Strafe(strafe.clone())),
            (_, Task::Rail(follower)) => Some(Moving::Rail(follower.clone())),
            (_, Task::Halt { moving, .. }) => Some(moving.clone()),
            _ => None,
        }
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
        let turn = TurnTo::new(self.position, self.yaw_rad, yaw_rad, &self.settings.inspect);
        self.begin(Mode::Transit, Task::Turn(turn));
    }

    /// Inspects a segment along a line, fitted into the mesh, ending at the stopping distance before the line's end.
    ///
    /// # Errors
    /// When there is no such segment, or nothing of the line can be reached.
    pub fn inspect(&mut self, segment: u32, line: &[Vec2]) -> Result<(), FlightError> {
        let inspection = self.inspection_of(segment, false)?;
        let way = course(&self.ground.mesh, self.position, line)?;
        let flown = shortened(&way, self.settings.stopping_distance_m);
        let rail = Rail::new(&self.ground.mesh, &flown, &self.settings.inspect)?;
        self.begin(Mode::Inspect, Task::Rail(Box::new(Follower::new(rail, self.yaw_rad))));
        self.inspection = Some(inspection);
        self.course = way;
        Ok(())
    }

    /// Stays where it is and looks at a segment: a revisit.
    ///
    /// # Errors
    /// When there is no such segment.
    pub fn revisit(&mut self, segment: u32, stay_s: f64) -> Result<(), FlightError> {
        let inspection = self.inspection_of(segment, true)?;
        self.begin(Mode::Revisit, Task::Stay { until_tick: self.tick + self.ticks(stay_s) });
        self.inspection = Some(inspection);
        Ok(())
    }

    /// Stands on the ground until the battery has been swapped.
    pub fn swap_battery(&mut self, swap_s: f64) {
        self.begin(Mode::Swap, Task::Stay { until_tick: self.tick + self.ticks(swap_s) });
        self.battery = 1.0;
        self.heading_home = false;
        (self.home_bound_m, self.home_turns_s) = (0.0, 0.0);
    }

    /// Goes on in a longer recording that begins with the present one.
    ///
    /// # Errors
    /// When it does not.
    pub fn extend(&mut self, trace: Arc<Trace>) -> Result<(), FlightError> {
        if !self.trace.is_prefix_of(&trace) {
            return Err(FlightError::OtherRecording);
        }
        self.shared_airspace = reaches(&trace, self.settings.altitude_m);
        self.trace = trace;
        Ok(())
    }

    /// What is left of the line under inspection, from where the UAV is; empty when it flies none.
    pub fn remaining(&self) -> Vec<Vec2> {
        if matches!(self.task, Task::Rail(_)) { rest_of(&self.course, self.position) } else { Vec::new() }
    }

    /// The present moment, for a policy; `None` when nothing is under inspection.
    pub fn moment(&self) -> Option<Moment> {
        let inspection = self.inspection.as_ref()?;
        let rest = match &self.task {
            Task::Rail(follower) => {
                let brake_m = self.speed_mps * self.speed_mps / (2.0 * self.settings.inspect.acceleration_mps2);
                follower.rail().sample(follower.s_m() + brake_m).0
            }
            _ => self.position,
        };
        Some(Moment::new(
            self.ground.clone(),
            self.trace.clone(),
            &self.settings,
            self.viewpoint(),
            rest,
            self.speed_mps,
            inspection.segment,
            self.time_s(),
        ))
    }

    fn begin(&mut self, mode: Mode, task: Task) {
        self.mode = mode;
        self.task = task;
        self.reaction = Reaction::None;
        self.encounter = None;
        self.episode = None;
        self.inspection = None;
        self.course.clear();
        self.queue.clear();
    }

    fn inspection_of(&self, segment: u32, on_revisit: bool) -> Result<Inspection, FlightError> {
        let segments = self.ground.segments.len();
        if segment as usize >= segments {
            return Err(FlightError::UnknownSegment { segment, segments });
        }
        Ok(Inspection { segment, on_revisit, next_look_tick: self.tick, next_capture_tick: self.tick })
    }

    pub(super) fn ticks(&self, seconds: f64) -> u64 {
        (seconds / self.settings.time_step_s).round().max(0.0) as u64
    }

    pub fn time_s(&self) -> f64 {
        self.tick as f64 * self.settings.time_step_s
    }

    pub fn viewpoint(&self) -> Viewpoint {
        Viewpoint { position: self.position, altitude_m: self.altitude_m, yaw_rad: self.yaw_rad }
    }

    pub fn speed_mps(&self) -> f64 {
        self.speed_mps
    }

    /// Over the ground.
    pub fn velocity_mps(&self) -> Vec2 {
        if let Some(encounter) = &self.encounter {
            return encounter.velocity_mps;
        }
        match (&self.reaction, &self.task) {
            (Reaction::Out { strafe, .. } | Reaction::Back { strafe }, _) => strafe.velocity_mps(),
            (_, Task::Rail(follower)) => follower.velocity_mps(),
            (_, Task::Halt { moving, .. }) => moving.velocity_mps(),
            _ => Vec2::ZERO,
        }
    }

    pub fn battery(&self) -> f64 {
        self.battery
    }

    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Share of a battery drained since the beginning, over all swaps.
    pub fn energy_used(&self) -> f64 {
        self.energy_used
    }

    /// Flown over the ground since the beginning, metres.
    pub fn distance_m(&self) -> f64 {
        self.distance_m
    }

    /// Time spent waiting for a policy since the beginning.
    pub fn waited_s(&self) -> f64 {
        self.waited_ticks as f64 * self.settings.time_step_s
    }

    /// Episodes of occlusion since the beginning.
    pub fn occlusions(&self) -> u32 {
        self.occlusions
    }

    /// Share of a segment's cells seen so far.
    pub fn surface_coverage(&self, segment: u32) -> f64 {
        let grid = &self.ground.segments[segment as usize].grid;
        let seen = self.seen[segment as usize].as_ref();
        seen.map_or(0.0, |cells| cells.count() as f64 / grid.cell_count().max(1) as f64)
    }

    /// Whether a defect's centre has been in the moving inspection window.
    pub fn swept(&self) -> &[bool] {
        &self.swept
    }

    /// Whether captures should still report a defect.
    pub fn set_wanted(&mut self, defect: u32, wanted: bool) {
        self.wanted[defect as usize] = wanted;
    }

    pub fn track(&self) -> &Track {
        &self.track
    }

    pub fn captures(&self) -> &Captures {
        &self.captures
    }
}
