//! What the kernel stops for: the moments that need a decision from above.

use crate::geometry::Vec2;
use crate::sensing::Viewpoint;

/// A defect whose centre is in the inspection window and enough of whose area is visible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    pub defect: u32,
    pub visible_fraction: f64,
}

/// One capture, and the wanted defects that it shows.
#[derive(Debug, Clone, PartialEq)]
pub struct Capture {
    /// Its row in the log of captures.
    pub number: u32,
    pub time_s: f64,
    pub viewpoint: Viewpoint,
    /// Of the UAV over the ground, m/s.
    pub velocity_mps: Vec2,
    pub segment: u32,
    pub on_revisit: bool,
    /// o; `None` when C is empty.
    pub visibility: Option<f64>,
    pub sightings: Vec<Sighting>,
}

/// A look that fell below the threshold, and the episode it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OcclusionReport {
    pub time_s: f64,
    /// o, in [0, threshold).
    pub visibility: f64,
    pub hidden_centroid: Option<Vec2>,
    /// Of the cells in the window, the share that parked vehicles hide; they do not count in o.
    pub permanently_hidden: f64,
    /// When visibility last fell below the threshold.
    pub since_s: f64,
    /// Waited since then.
    pub waited_s: f64,
    /// Displacements since then.
    pub displacements: u32,
    /// Flown since the last of them; infinite when there was none.
    pub since_displacement_m: f64,
}

/// Something that needs deciding.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The command has been carried out.
    Arrived,
    /// The moment given to `advance` is reached; nothing else has happened.
    Paused,
    Captured(Capture),
    Occluded(OcclusionReport),
    /// Going home now leaves just the reserve.
    BatteryLow,
    /// The next step lies past the end of the recording, which must be extended.
    RecordingEnds,
}
