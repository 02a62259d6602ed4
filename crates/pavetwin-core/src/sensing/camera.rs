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

    /// The inspection window.
    pub fn window(&self, altitude_m: f64) -> Window {
        let (along_m, across_m) = self.footprint(altitude_m);
        let width_m = match self.window.across {
            AcrossRule::Columns(share) => share * across_m,
            AcrossRule::PerAltitude(factor) => (factor * altitude_m).min(across_m),
        };
        Window { half_along_m: 0.5 * self.window.rows_share * along_m, half_across_m: 0.5 * width_m }
    }

    /// The inspection window at its place on the ground.
    pub fn placed_window(&self, viewpoint: &Viewpoint) -> PlacedWindow {
        viewpoint.place(self.window(viewpoint.altitude_m))
    }
}
