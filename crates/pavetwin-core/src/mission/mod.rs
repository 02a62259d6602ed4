//! The mission's clock: runs to the next event, and leaves the deciding to those above.
//!
//! - [`Ground`] is what stands still at one altitude, shared by all missions over it.
//! - [`Flight`] carries out commands (climb, fly, inspect, stay) step by step and stops at every [`Event`].
//! - [`Moment`] keeps one moment, so that a policy can ask what it did not need to be told.

mod battery;
mod course;
mod encounter;
mod event;
mod flight;
mod ground;
mod log;
mod looking;
mod moment;
mod reaction;
mod settings;
mod stepping;

pub use battery::DrainCurve;
pub use course::{course, nearest_reachable, rest_of, shortened};
pub use event::{Capture, Event, OcclusionReport, Sighting};
pub use flight::{Flight, FlightError, Mode};
pub use ground::{DefectTarget, Ground, GroundError, SegmentSurface};
pub use log::{Captures, Track};
pub use moment::Moment;
pub use settings::{Settings, SettingsError};
