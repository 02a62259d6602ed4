//! The battery, drained by a curve over airspeed.

use super::error::SettingsError;
use crate::geometry::Vec2;

/// Battery drained at each airspeed: the model is chosen above, the kernel only integrates it.
#[derive(Debug, Clone, PartialEq)]
pub struct DrainCurve {
    /// Share of the battery a second at airspeeds 0, `step_mps`, 2·`step_mps` …, without `lift_per_s`; linear between,
    /// constant beyond.
    pub per_s: Vec<f64>,
    /// The part that lift takes and that moving through the air saves (induced power): it falls with airspeed. As many
    /// entries.
    pub lift_per_s: Vec<f64>,
    pub step_mps: f64,
    /// Share of the battery a metre climbed, on top.
    pub per_m_climbed: f64,
    /// Velocity of the air over the ground, m/s.
    pub wind: Vec2,
}

impl DrainCurve {
    /// Share of the battery a second at an airspeed, and at a ground speed.
    ///
    /// The lift of moving through the air counts up to the ground speed only: wind alone saves nothing.
    pub fn at(&self, airspeed_mps: f64, ground_mps: f64) -> f64 {
        self.read(&self.per_s, airspeed_mps) + self.read(&self.lift_per_s, airspeed_mps.min(ground_mps))
    }

    fn read(&self, per_s: &[f64], speed_mps: f64) -> f64 {
        let last = per_s.len() - 1;
        let place = (speed_mps / self.step_mps).clamp(0.0, last as f64);
        let below = (place as usize).min(last.saturating_sub(1));
        let above = (below + 1).min(last);
        per_s[below] + (per_s[above] - per_s[below]) * (place - below as f64)
    }

    /// Share drained in `dt_s` at a ground velocity and a climb rate (negative when sinking, which gives nothing back).
    pub fn drained(&self, velocity: Vec2, climb_mps: f64, dt_s: f64) -> f64 {
        let airspeed = (velocity - self.wind).length();
        (self.at(airspeed, velocity.length()) + self.per_m_climbed * climb_mps.max(0.0)) * dt_s
    }

    /// Upper bound of the share that flying `distance_m` and landing from `altitude_m` drains, turns and braking
    /// allowed for by `manoeuvre_s` of the costlier of hovering and cruising.
    pub fn home(&self, distance_m: f64, speed_mps: f64, altitude_m: f64, sink_mps: f64, manoeuvre_s: f64) -> f64 {
        let wind = self.wind.length();
        let head_wind = self.at(speed_mps + wind, speed_mps);
        let tail_wind = self.at((speed_mps - wind).max(0.0), speed_mps);
        let cruise = head_wind.max(tail_wind);
        let hover = self.at(wind, 0.0);
        distance_m / speed_mps * cruise + altitude_m / sink_mps * hover + manoeuvre_s * hover.max(cruise)
    }
}

/// The battery that a mission is flown with.
#[derive(Debug, Clone, PartialEq)]
pub struct Battery {
    pub drain: DrainCurve,
    /// Share that must be left after landing.
    pub reserve: f64,
}

impl Battery {
    /// Whether the numbers describe a battery.
    ///
    /// # Errors
    /// The first that does not fit.
    pub fn check(&self) -> Result<(), SettingsError> {
        SettingsError::unless_positive("number of drain_per_s entries", self.drain.per_s.len() as f64)?;
        for &per_s in &self.drain.per_s {
            SettingsError::unless_zero_or_more("drain_per_s", per_s)?;
        }
        let missing = self.drain.per_s.len().abs_diff(self.drain.lift_per_s.len());
        SettingsError::unless_zero("number of lift_per_s entries, less those of drain_per_s,", missing as f64)?;
        for &per_s in &self.drain.lift_per_s {
            SettingsError::unless_zero_or_more("lift_per_s", per_s)?;
        }
        SettingsError::unless_positive("drain_step_mps", self.drain.step_mps)?;
        SettingsError::unless_zero_or_more("drain_per_m_climbed", self.drain.per_m_climbed)?;
        SettingsError::unless_zero_or_more("speed of wind_mps", self.drain.wind.length())?;
        SettingsError::unless_share("reserve", self.reserve)
    }
}

/// e: what is left in the battery, and what was used over all swaps, as shares of one battery.
#[derive(Debug, Clone, Copy)]
pub(super) struct Charge {
    pub left: f64,
    pub used: f64,
}

impl Charge {
    pub fn full() -> Self {
        Self { left: 1.0, used: 0.0 }
    }

    /// Drains a share; false when nothing is left.
    pub fn drain(&mut self, share: f64) -> bool {
        self.used += share;
        self.left -= share;
        self.left > 0.0
    }

    pub fn swap(&mut self) {
        self.left = 1.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve() -> DrainCurve {
        let per_s = vec![1.0, 0.8, 2.0];
        DrainCurve { per_s, lift_per_s: vec![0.0; 3], step_mps: 5.0, per_m_climbed: 0.1, wind: Vec2::ZERO }
    }

    #[test]
    fn is_linear_between_entries_and_constant_beyond() {
        assert!((curve().at(2.5, 2.5) - 0.9).abs() < 1e-12);
        assert!((curve().at(7.5, 7.5) - 1.4).abs() < 1e-12);
        assert_eq!(curve().at(99.0, 99.0), 2.0);
    }

    #[test]
    fn a_tail_wind_is_felt_as_less_airspeed() {
        let windy = DrainCurve { wind: Vec2::new(5.0, 0.0), ..curve() };
        assert!((windy.drained(Vec2::new(5.0, 0.0), 0.0, 1.0) - 1.0).abs() < 1e-12);
        assert!((windy.drained(Vec2::new(-5.0, 0.0), 0.0, 1.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn wind_alone_lifts_nothing() {
        let lifted = DrainCurve {
            per_s: vec![1.0, 1.2, 2.0],
            lift_per_s: vec![1.0, 0.5, 0.1],
            wind: Vec2::new(5.0, 0.0),
            ..curve()
        };
        assert!((lifted.drained(Vec2::ZERO, 0.0, 1.0) - (1.2 + 1.0)).abs() < 1e-12);
        assert!((lifted.drained(Vec2::new(-5.0, 0.0), 0.0, 1.0) - (2.0 + 0.5)).abs() < 1e-12);
        assert!((lifted.drained(Vec2::new(10.0, 0.0), 0.0, 1.0) - (1.2 + 0.5)).abs() < 1e-12);
    }

    #[test]
    fn climbing_costs_and_sinking_gives_nothing_back() {
        assert!((curve().drained(Vec2::ZERO, 2.0, 1.0) - 1.2).abs() < 1e-12);
        assert!((curve().drained(Vec2::ZERO, -2.0, 1.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_battery_is_refused_by_name() {
        let usual = Battery { drain: curve(), reserve: 0.15 };
        assert_eq!(usual.check(), Ok(()));
        for (name, battery) in [
            (
                "number of drain_per_s entries",
                Battery { drain: DrainCurve { per_s: Vec::new(), ..curve() }, reserve: 0.1 },
            ),
            (
                "number of lift_per_s entries, less those of drain_per_s,",
                Battery { drain: DrainCurve { lift_per_s: vec![0.0], ..curve() }, reserve: 0.1 },
            ),
            ("lift_per_s", Battery { drain: DrainCurve { lift_per_s: vec![0.0, 0.0, -1.0], ..curve() }, reserve: 0.1 }),
            ("drain_per_s", Battery { drain: DrainCurve { per_s: vec![1.0, f64::NAN], ..curve() }, reserve: 0.1 }),
            ("drain_step_mps", Battery { drain: DrainCurve { step_mps: 0.0, ..curve() }, reserve: 0.1 }),
            ("drain_per_m_climbed", Battery { drain: DrainCurve { per_m_climbed: -1.0, ..curve() }, reserve: 0.1 }),
            ("reserve", Battery { drain: curve(), reserve: 1.5 }),
        ] {
            assert_eq!(battery.check().expect_err(name).name, name);
        }
    }

    #[test]
    fn a_swap_fills_the_battery_and_keeps_what_was_used() {
        let mut charge = Charge::full();
        assert!(charge.drain(0.75));
        charge.swap();
        assert!(charge.drain(0.5));
        assert_eq!((charge.left, charge.used), (0.5, 1.25));
        assert!(!charge.drain(0.5));
    }
}
