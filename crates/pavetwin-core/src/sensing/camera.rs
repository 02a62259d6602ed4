//! The downward-looking camera: what it frames on the ground, and which part of that counts as inspected.

use crate::geometry::Vec2;

/// Why a camera or a viewpoint cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    #[error("an image needs at least one row and one column, not {width_px} × {height_px} pixels")]
    Image { width_px: u32, height_px: u32 },
    #[error("a vertical field of view lies between 0 and 180 degrees, not at {0:.3} rad")]
    FieldOfView(f64),
    #[error("the inspection window's share of the {side} must be above 0 and at most 1, not {share}")]
    Share { side: &'static str, share: f64 },
    #[error("the inspection window's width for each metre of altitude must be positive, not {0}")]
    PerAltitude(f64),
    #[error("a camera needs a position, a yaw and an altitude above 0, not {altitude_m} m")]
    Viewpoint { altitude_m: f64 },
}

/// How wide the inspection window is across the track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AcrossRule {
    /// The central share of the image columns, in (0, 1].
    Columns(f64),
    /// Metres of width for each metre of altitude, never more than the footprint.
    PerAltitude(f64),
}

/// Which part of the footprint counts as the inspection window; it is centred in the footprint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WindowRule {
    /// The central share of the image rows (along the track), in (0, 1].
    pub rows_share: f64,
    pub across: AcrossRule,
}

impl WindowRule {
    /// The paper's window (arXiv 2606.20742): 260 of 950 rows, 0.6 m across for each metre of altitude.
    pub const PAPER: Self = Self { rows_share: 260.0 / 950.0, across: AcrossRule::PerAltitude(0.6) };
    /// The central half of the rows, the whole width.
    pub const DEFAULT: Self = Self { rows_share: 0.5, across: AcrossRule::Columns(1.0) };

    fn check(&self) -> Result<(), CameraError> {
        let is_share = |share: f64| share > 0.0 && share <= 1.0;
        if !is_share(self.rows_share) {
            return Err(CameraError::Share { side: "rows", share: self.rows_share });
        }
        match self.across {
            AcrossRule::Columns(share) if !is_share(share) => Err(CameraError::Share { side: "columns", share }),
            AcrossRule::PerAltitude(factor) if !(factor.is_finite() && factor > 0.0) => {
                Err(CameraError::PerAltitude(factor))
            }
            _ => Ok(()),
        }
    }
}

/// A rectangle on the ground, centred below the camera and turned with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Half the extent along the track (the yaw direction), metres.
    pub half_along_m: f64,
    /// Half the extent across the track, metres.
    pub half_across_m: f64,
}

impl Window {
    /// Distance from the centre to a corner, metres.
    pub fn half_diagonal_m(&self) -> f64 {
        self.half_along_m.hypot(self.half_across_m)
    }
}

/// Where a camera is and which way it is turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// The nadir: the point on the ground below the camera.
    pub position: Vec2,
    /// Height of the camera's centre above the ground, metres.
    pub altitude_m: f64,
    /// Direction in which the image rows count, counter-clockwise from east.
    pub yaw_rad: f64,
}

impl Viewpoint {
    /// Whether a picture can be taken from here.
    ///
    /// # Errors
    /// `Viewpoint` for an altitude that is not positive, or any value that is not finite.
    pub fn check(&self) -> Result<(), CameraError> {
        let finite = [self.position.x, self.position.y, self.altitude_m, self.yaw_rad].iter().all(|v| v.is_finite());
        if finite && self.altitude_m > 0.0 {
            Ok(())
        } else {
            Err(CameraError::Viewpoint { altitude_m: self.altitude_m })
        }
    }

    /// The corners of `window` in the world frame, counter-clockwise from the front left.
    pub fn corners(&self, window: Window) -> [Vec2; 4] {
        let ahead = Vec2::from_yaw(self.yaw_rad);
        let (along, across) = (ahead * window.half_along_m, ahead.left() * window.half_across_m);
        let at = self.position;
        [at + along + across, at - along + across, at - along - across, at + along - across]
    }

    /// `window` below the camera, to be asked about many points.
    pub fn place(&self, window: Window) -> PlacedWindow {
        PlacedWindow { centre: self.position, ahead: Vec2::from_yaw(self.yaw_rad), window }
    }
}

/// A window at its place on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedWindow {
    centre: Vec2,
    /// The direction along the track.
    ahead: Vec2,
    window: Window,
}

impl PlacedWindow {
    /// Whether `point` lies in the window, its rim included.
    pub fn contains(&self, point: Vec2) -> bool {
        let (offset, ahead, window) = (point - self.centre, self.ahead, self.window);
        offset.dot(ahead).abs() <= window.half_along_m && offset.dot(ahead.left()).abs() <= window.half_across_m
    }
}

/// A camera that looks straight down. Image rows count along the track (the yaw direction), columns across it; pixels
/// are square and there is no distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NadirCamera {
    image_width_px: u32,
    image_height_px: u32,
    vertical_fov_rad: f64,
    window: WindowRule,
    /// Metres along the track in the image, for each metre of altitude.
    along_per_altitude: f64,
}

impl NadirCamera {
    /// # Errors
    /// The first value that describes no camera.
    pub fn new(
        image_width_px: u32,
        image_height_px: u32,
        vertical_fov_rad: f64,
        window: WindowRule,
    ) -> Result<Self, CameraError> {
        if image_width_px == 0 || image_height_px == 0 {
            return Err(CameraError::Image { width_px: image_width_px, height_px: image_height_px });
        }
        if !(vertical_fov_rad > 0.0 && vertical_fov_rad < std::f64::consts::PI) {
            return Err(CameraError::FieldOfView(vertical_fov_rad));
        }
        window.check()?;
        let along_per_altitude = 2.0 * (0.5 * vertical_fov_rad).tan();
        Ok(Self { image_width_px, image_height_px, vertical_fov_rad, window, along_per_altitude })
    }

    pub fn image_width_px(&self) -> u32 {
        self.image_width_px
    }

    pub fn image_height_px(&self) -> u32 {
        self.image_height_px
    }

    /// Angle between the first and the last image row.
    pub fn vertical_fov_rad(&self) -> f64 {
        self.vertical_fov_rad
    }

    pub fn window_rule(&self) -> WindowRule {
        self.window
    }

    /// Ground in the image, as `(along_m, across_m)`: full extents along and across the track.
    pub fn footprint(&self, altitude_m: f64) -> (f64, f64) {
        let along_m = self.along_per_altitude * altitude_m;
        (along_m, along_m * f64::from(self.image_width_px) / f64::from(self.image_height_px))
    }

    /// The whole footprint as a window.
    pub fn footprint_window(&self, altitude_m: f64) -> Window {
        let (along_m, across_m) = self.footprint(altitude_m);
        Window { half_along_m: 0.5 * along_m, half_across_m: 0.5 * across_m }
    }

    /// The inspection window.
    pub fn window(&self, altitude_m: f64) -> Window {
        let (along_m, across_m) = self.footprint(altitude_m);
        let width_m = match self.window.across {
            AcrossRule::Columns(share) => share * across_m,
            AcrossRule::PerAltitude(factor) => (factor * altitude_m).min(across_m),
        };
        Window { half_along_m: 0.5 * self.window.rows_share * along_m, half_across_m: 0.5 * width_m }
    }

    /// Metres on the ground for each pixel.
    pub fn ground_resolution_m(&self, altitude_m: f64) -> f64 {
        self.footprint(altitude_m).0 / f64::from(self.image_height_px)
    }

    /// The inspection window's corners in the world frame, counter-clockwise.
    pub fn window_corners(&self, viewpoint: &Viewpoint) -> [Vec2; 4] {
        viewpoint.corners(self.window(viewpoint.altitude_m))
    }

    /// The footprint's corners in the world frame, counter-clockwise.
    pub fn footprint_corners(&self, viewpoint: &Viewpoint) -> [Vec2; 4] {
        viewpoint.corners(self.footprint_window(viewpoint.altitude_m))
    }

    /// The inspection window at its place on the ground.
    pub fn placed_window(&self, viewpoint: &Viewpoint) -> PlacedWindow {
        viewpoint.place(self.window(viewpoint.altitude_m))
    }

    /// The whole footprint at its place on the ground.
    pub fn placed_footprint(&self, viewpoint: &Viewpoint) -> PlacedWindow {
        viewpoint.place(self.footprint_window(viewpoint.altitude_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(rule: WindowRule) -> NadirCamera {
        NadirCamera::new(1270, 950, 60f64.to_radians(), rule).expect("a camera")
    }

    #[test]
    fn the_papers_window_at_15_m() {
        let window = camera(WindowRule::PAPER).window(15.0);
        assert!((2.0 * window.half_along_m - 17.3205 * 260.0 / 950.0).abs() < 1e-3);
        assert!((2.0 * window.half_across_m - 9.0).abs() < 1e-12);
    }

    #[test]
    fn the_default_window_at_15_m() {
        let window = camera(WindowRule::DEFAULT).window(15.0);
        assert!((2.0 * window.half_along_m - 8.660).abs() < 1e-3);
        assert!((2.0 * window.half_across_m - 23.155).abs() < 1e-3);
        assert!((camera(WindowRule::DEFAULT).ground_resolution_m(15.0) - 0.018232).abs() < 1e-6);
    }

    #[test]
    fn a_window_never_leaves_the_image() {
        let rule = WindowRule { rows_share: 1.0, across: AcrossRule::PerAltitude(9.0) };
        assert_eq!(camera(rule).window(10.0), camera(rule).footprint_window(10.0));
    }

    #[test]
    fn rows_run_along_the_yaw_and_corners_turn_left() {
        let camera = camera(WindowRule::DEFAULT);
        let north = Viewpoint { position: Vec2::new(3.0, 4.0), altitude_m: 15.0, yaw_rad: std::f64::consts::FRAC_PI_2 };
        assert!(camera.placed_window(&north).contains(Vec2::new(14.0, 8.0)));
        assert!(!camera.placed_window(&north).contains(Vec2::new(3.0, 9.0)));
        assert!(camera.placed_footprint(&north).contains(Vec2::new(3.0, 9.0)));
        let corners = camera.window_corners(&north);
        for i in 0..4 {
            assert!((corners[(i + 1) % 4] - corners[i]).cross(corners[(i + 2) % 4] - corners[(i + 1) % 4]) > 0.0);
        }
    }

    #[test]
    fn what_is_no_camera_is_refused() {
        let rule = WindowRule { rows_share: 0.0, across: AcrossRule::Columns(1.0) };
        assert!(matches!(NadirCamera::new(10, 10, 1.0, rule), Err(CameraError::Share { side: "rows", .. })));
        assert!(matches!(NadirCamera::new(0, 10, 1.0, WindowRule::PAPER), Err(CameraError::Image { .. })));
        assert!(matches!(NadirCamera::new(10, 10, 3.2, WindowRule::PAPER), Err(CameraError::FieldOfView(_))));
        let below = Viewpoint { position: Vec2::ZERO, altitude_m: 0.0, yaw_rad: 0.0 };
        assert!(below.check().is_err());
    }
}
