//! The camera: its inspection window on the ground, and what is refused.

use crate::support::{DEFAULT, PAPER, camera};
use pavetwin_core::geometry::Vec2;
use pavetwin_core::sensing::{AcrossRule, CameraError, NadirCamera, Viewpoint, Window, WindowRule};

#[test]
fn the_papers_window_at_15_m() {
    let window = camera(PAPER).window(15.0);
    assert!((2.0 * window.half_along_m - 17.3205 * 260.0 / 950.0).abs() < 1e-3);
    assert!((2.0 * window.half_across_m - 9.0).abs() < 1e-12);
}

#[test]
fn the_default_window_at_15_m() {
    let window = camera(DEFAULT).window(15.0);
    assert!((2.0 * window.half_along_m - 8.660).abs() < 1e-3);
    assert!((2.0 * window.half_across_m - 23.155).abs() < 1e-3);
}

#[test]
fn a_window_never_leaves_the_image() {
    let rule = WindowRule { rows_share: 1.0, across: AcrossRule::PerAltitude(9.0) };
    let (along_m, across_m) = camera(rule).footprint(10.0);
    assert_eq!(camera(rule).window(10.0), Window { half_along_m: 0.5 * along_m, half_across_m: 0.5 * across_m });
}

#[test]
fn rows_run_along_the_yaw_and_corners_turn_left() {
    let camera = camera(DEFAULT);
    let north = Viewpoint { position: Vec2::new(3.0, 4.0), altitude_m: 15.0, yaw_rad: std::f64::consts::FRAC_PI_2 };
    assert!(camera.placed_window(&north).contains(Vec2::new(14.0, 8.0)));
    assert!(!camera.placed_window(&north).contains(Vec2::new(3.0, 9.0)));
    let corners = north.corners(camera.window(north.altitude_m));
    for i in 0..4 {
        assert!((corners[(i + 1) % 4] - corners[i]).cross(corners[(i + 2) % 4] - corners[(i + 1) % 4]) > 0.0);
    }
}

#[test]
fn what_is_no_camera_is_refused() {
    let rule = WindowRule { rows_share: 0.0, across: AcrossRule::Columns(1.0) };
    assert!(matches!(NadirCamera::new(10, 10, 1.0, rule), Err(CameraError::Share { side: "rows", .. })));
    assert!(matches!(NadirCamera::new(0, 10, 1.0, PAPER), Err(CameraError::Image { .. })));
    assert!(matches!(NadirCamera::new(10, 10, 3.2, PAPER), Err(CameraError::FieldOfView(_))));
    let below = Viewpoint { position: Vec2::ZERO, altitude_m: 0.0, yaw_rad: 0.0 };
    assert!(below.check().is_err());
}
