//! Kernels of PaveTwin, in pure Rust.
//!
//! The world frame is east-north-up in metres; angles are `yaw_rad`, counter-clockwise from east; times are seconds.
#![forbid(unsafe_code)]

pub mod geometry;
pub mod imaging;
pub mod mission;
pub mod navigation;
pub mod raster;
pub mod relief;
pub mod sensing;
pub mod texture;
