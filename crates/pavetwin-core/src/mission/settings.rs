//! How a mission is flown, in the kernel's terms.

use super::battery::DrainCurve;
use crate::navigation::Limits;
use crate::sensing::Camera;

/// Why settings cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} must be {expected}, not {found}")]
pub struct SettingsError {
    pub name: &'static str,
    pub expected: &'static str,
    pub found: f64,
}

/// One mission's numbers. Intervals are whole numbers of time steps.
#[derive(Debug, Clone)]
pub struct Settings {
    pub time_step_s: f64,
    pub altitude_m: f64,
    pub radius_m: f64,
    /// While inspecting and displacing.
    pub inspect: Limits,
    /// Between segments, to revisits and home.
    pub transit: Limits,
    pub stopping_distance_m: f64,
    pub climb_speed_mps: f64,
    pub camera: Camera,
    pub look_steps: u32,
    pub capture_steps: u32,
    /// Stop at every capture, not only at those that show a wanted defect.
    pub every_capture: bool,
    /// τ_o.
    pub threshold: f64,
    /// A defect is sighted when at least this share of its area is unoccluded.
    pub min_visible_fraction: f64,
    pub drain: DrainCurve,
    /// Share of the battery that must be left after landing.
    pub reserve: f64,
}

impl Settings {
    /// Whether the numbers describe a mission.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn check(&self) -> Result<(), SettingsError> {
        let positive = [
            ("time_step_s", self.time_step_s),
            ("altitude_m", self.altitude_m),
            ("radius_m", self.radius_m),
            ("inspect speed", self.inspect.speed_mps),
            ("transit speed", self.transit.speed_mps),
            ("acceleration", self.inspect.acceleration_mps2),
            ("yaw rate", self.inspect.yaw_rate_rad_s),
            ("climb_speed_mps", self.climb_speed_mps),
            ("look_steps", f64::from(self.look_steps)),
            ("capture_steps", f64::from(self.capture_steps)),
            ("drain entries", self.drain.per_s.len() as f64),
        ];
        for (name, found) in positive {
            if !(found.is_finite() && found > 0.0) {
                return Err(SettingsError { name, expected: "positive", found });
            }
        }
        let shares = [
            ("threshold", self.threshold),
            ("min_visible_fraction", self.min_visible_fraction),
            ("reserve", self.reserve),
        ];
        for (name, found) in shares {
            if !(0.0..=1.0).contains(&found) {
                return Err(SettingsError { name, expected: "a share between 0 and 1", found });
            }
        }
        Ok(())
    }
}
