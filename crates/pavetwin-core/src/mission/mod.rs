//! The mission's clock: runs to the next event, and leaves the deciding to those above.
//!
//! - [`Ground`] is what stands still at one altitude, shared by all missions over it.
//! - [`Flight`] carries out commands (climb, fly, inspect, stay) step by step and stops at every [`Event`].
//! - [`DisplacementPredictor`] keeps the state at one time and predicts visibility after displacements from it.
//!
//! A flight is composed of parts (clock, UAV state, charge, task, reaction, encounter, inspection, occlusions,
//! coverage, way home, log). No part knows the flight, and no file uses one that uses it.

mod battery;
mod clock;
mod course;
mod coverage;
mod displacement;
mod encounter;
mod error;
mod event;
mod flight;
mod ground;
mod inspection;
mod log;
mod looking;
mod mode;
mod occlusions;
mod reaction;
mod settings;
mod steering;
mod stepping;
mod task;
mod uav;
mod way_home;

pub use battery::{Battery, DrainCurve};
pub use course::{course, nearest_reachable, rest_of, shortened};
pub use displacement::DisplacementPredictor;
pub use error::{FlightError, SettingsError};
pub use event::{Capture, Event, OcclusionReport, Sighting};
pub use flight::Flight;
pub use ground::{DefectTarget, Ground, GroundError, SegmentSurface};
pub use log::{Captures, Track};
pub use mode::Mode;
pub use settings::Settings;
pub use steering::Steer;
