//! What a mission leaves behind as it flies: the track and the captures, as columns.

use super::mode::Mode;
use crate::sensing::Viewpoint;

/// The time series of x_t, one row a look interval.
#[derive(Debug, Clone, Default)]
pub struct Track {
    pub time_s: Vec<f64>,
    pub x_m: Vec<f64>,
    pub y_m: Vec<f64>,
    pub altitude_m: Vec<f64>,
    pub yaw_rad: Vec<f64>,
    pub speed_mps: Vec<f64>,
    pub battery: Vec<f64>,
    pub mode: Vec<u8>,
    /// Segment under inspection, −1 for none.
    pub segment: Vec<i32>,
    /// o, NaN when nothing was looked at or C was empty.
    pub visibility: Vec<f64>,
}

/// One row of the track.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrackRow {
    pub time_s: f64,
    pub viewpoint: Viewpoint,
    pub speed_mps: f64,
    pub battery: f64,
    pub mode: Mode,
    pub segment: Option<u32>,
    pub visibility: Option<f64>,
}

impl Track {
    pub(super) fn push(&mut self, row: &TrackRow) {
        self.time_s.push(row.time_s);
        self.x_m.push(row.viewpoint.position.x);
        self.y_m.push(row.viewpoint.position.y);
        self.altitude_m.push(row.viewpoint.altitude_m);
        self.yaw_rad.push(row.viewpoint.yaw_rad);
        self.speed_mps.push(row.speed_mps);
        self.battery.push(row.battery);
        self.mode.push(row.mode as u8);
        self.segment.push(row.segment.map_or(-1, |segment| segment as i32));
        self.visibility.push(row.visibility.unwrap_or(f64::NAN));
    }
}

/// Every capture, whether it showed something wanted or not.
#[derive(Debug, Clone, Default)]
pub struct Captures {
    pub time_s: Vec<f64>,
    pub x_m: Vec<f64>,
    pub y_m: Vec<f64>,
    pub yaw_rad: Vec<f64>,
    pub segment: Vec<i32>,
    pub visibility: Vec<f64>,
    pub on_revisit: Vec<bool>,
}

/// One capture, as a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct CaptureRow {
    pub time_s: f64,
    pub viewpoint: Viewpoint,
    pub segment: u32,
    pub visibility: Option<f64>,
    pub on_revisit: bool,
}

impl Captures {
    /// Adds a capture and answers its number.
    pub(super) fn push(&mut self, row: &CaptureRow) -> u32 {
        let number = self.time_s.len() as u32;
        self.time_s.push(row.time_s);
        self.x_m.push(row.viewpoint.position.x);
        self.y_m.push(row.viewpoint.position.y);
        self.yaw_rad.push(row.viewpoint.yaw_rad);
        self.segment.push(row.segment as i32);
        self.visibility.push(row.visibility.unwrap_or(f64::NAN));
        self.on_revisit.push(row.on_revisit);
        number
    }
}

/// Both, and when the track's next row is due.
#[derive(Debug, Clone, Default)]
pub(super) struct Log {
    pub track: Track,
    pub captures: Captures,
    pub next_row_tick: u64,
}
