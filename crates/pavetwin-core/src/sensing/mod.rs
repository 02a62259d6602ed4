//! What the camera sees: the recorded traffic, the solids, the surface cells, and which of them are hidden.
//!
//! Frames and units throughout: the world is east-north-up in metres with the ground at z = 0, `yaw_rad` is
//! counter-clockwise from east, times are seconds from the start of the recording.

mod camera;
mod cell_set;
mod cells;
mod grid;
mod occlusion;
mod patch;
mod predict;
mod raster;
mod reach;
mod shadow;
mod solids;
mod stretch;
mod trace;
mod trace_columns;

pub use camera::{AcrossRule, CameraError, NadirCamera, PlacedWindow, Viewpoint, Window, WindowRule};
pub use cell_set::CellSet;
pub use grid::{GridError, GridShape, SurfaceGrid};
pub use occlusion::{Observer, PointShares, Scene, SenseError, Visibility};
pub use patch::Patch;
pub use predict::Predictor;
pub use reach::Reach;
pub use solids::{MIN_BASE_M2, Prism, Solid, SolidError, Solids};
pub use stretch::{KeyFrames, Stretch, TELEPORT_MPS};
pub use trace::{AgentPose, HELD_ROWS, ReadPart, Trace, TraceParts};
pub use trace_columns::{Body, BodyClass, ReaderError, TraceColumns, TraceError};
