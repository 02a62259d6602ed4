//! What tests and benchmarks share: the paper's agent (arXiv 2606.20742), its camera, and the two inspection windows.

#![allow(dead_code)] // no target uses all of it

use pavetwin_core::geometry::Vec2;
use pavetwin_core::navigation::Limits;
use pavetwin_core::sensing::{AcrossRule, NadirCamera, WindowRule};

pub const AGENT: Limits = Limits {
    speed_mps: 5.0,
    acceleration_mps2: 8.0,
    yaw_rate_rad_s: std::f64::consts::FRAC_PI_4,
    airspeed_mps: f64::INFINITY,
    wind: Vec2::ZERO,
};

/// The paper's window: 260 of 950 rows, 0.6 m across for each metre of altitude.
pub const PAPER: WindowRule = WindowRule { rows_share: 260.0 / 950.0, across: AcrossRule::PerAltitude(0.6) };

/// The central half of the rows, the whole width.
pub const DEFAULT: WindowRule = WindowRule { rows_share: 0.5, across: AcrossRule::Columns(1.0) };

pub fn camera(rule: WindowRule) -> NadirCamera {
    NadirCamera::new(1270, 950, 60f64.to_radians(), rule).expect("a camera")
}
