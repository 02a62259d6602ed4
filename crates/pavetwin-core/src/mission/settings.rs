//! How a mission is flown, in the kernel's terms.

use super::battery::Battery;
use super::error::{FlightError, SettingsError};
use crate::navigation::Limits;
use crate::sensing::NadirCamera;

/// One mission's numbers. Intervals are whole numbers of time steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    pub time_step_s: f64,
    pub altitude_m: f64,
    /// Of the UAV's body.
    pub radius_m: f64,
    /// An agent that reaches into the altitude ± this is at the UAV's own: the clearance of the flight domain.
    pub clearance_m: f64,
    /// While inspecting and displacing.
    pub inspect: Limits,
    /// Between segments, to revisits and home.
    pub transit: Limits,
    pub stopping_distance_m: f64,
    pub climb_speed_mps: f64,
    pub camera: NadirCamera,
    pub look_steps: u32,
    pub capture_steps: u32,
    /// Stop at every capture, not only at those that show a wanted defect.
    pub every_capture: bool,
    /// τ_o.
    pub threshold: f64,
    /// A defect is sighted when at least this share of its area is visible.
    pub min_visible_fraction: f64,
    pub battery: Battery,
}

impl Settings {
    /// Whether the numbers describe a mission.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn check(&self) -> Result<(), FlightError> {
        self.inspect.check()?;
        self.transit.check()?;
        self.battery.check()?;
        for (name, found) in [
            ("time_step_s", self.time_step_s),
            ("altitude_m", self.altitude_m),
            ("radius_m", self.radius_m),
            ("climb_speed_mps", self.climb_speed_mps),
            ("look_steps", f64::from(self.look_steps)),
            ("capture_steps", f64::from(self.capture_steps)),
        ] {
            SettingsError::unless_positive(name, found)?;
        }
        SettingsError::unless_zero_or_more("clearance_m", self.clearance_m)?;
        SettingsError::unless_zero_or_more("stopping_distance_m", self.stopping_distance_m)?;
        SettingsError::unless_share("threshold", self.threshold)?;
        SettingsError::unless_share("min_visible_fraction", self.min_visible_fraction)?;
        Ok(())
    }
}
