//! Why a mission cannot be flown as it was asked for.

use crate::navigation::NavMeshError;
use crate::sensing::SenseError;

/// A number that describes no mission.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{name} must be {expected}, not {found}")]
pub struct SettingsError {
    pub name: &'static str,
    pub expected: &'static str,
    pub found: f64,
}

impl SettingsError {
    pub(super) fn unless_positive(name: &'static str, found: f64) -> Result<(), Self> {
        Self::unless(found.is_finite() && found > 0.0, name, "positive", found)
    }

    pub(super) fn unless_share(name: &'static str, found: f64) -> Result<(), Self> {
        Self::unless((0.0..=1.0).contains(&found), name, "a share between 0 and 1", found)
    }

    pub(super) fn unless_zero_or_more(name: &'static str, found: f64) -> Result<(), Self> {
        Self::unless(found.is_finite() && found >= 0.0, name, "zero or more", found)
    }

    pub(super) fn unless_zero(name: &'static str, found: f64) -> Result<(), Self> {
        Self::unless(found == 0.0, name, "zero", found)
    }

    fn unless(fits: bool, name: &'static str, expected: &'static str, found: f64) -> Result<(), Self> {
        if fits { Ok(()) } else { Err(Self { name, expected, found }) }
    }
}

/// Why a command or a step fails.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FlightError {
    #[error(transparent)]
    Settings(#[from] SettingsError),
    #[error(transparent)]
    NavMesh(#[from] NavMeshError),
    #[error(transparent)]
    Sense(#[from] SenseError),
    #[error("there is no segment {segment}; the ground has {segments}")]
    UnknownSegment { segment: u32, segments: usize },
    #[error("the battery ran empty after {time_s:.0} s in the air; raise energy.reserve or shorten the way")]
    BatteryEmpty { time_s: f64 },
    #[error("defect {defect} was not sampled before its segment was inspected")]
    NotSampled { defect: u32 },
    #[error("the UAV still moves at {speed_mps:.1} m/s; let it come to rest first")]
    StillMoving { speed_mps: f64 },
    #[error("the extended recording does not begin with the present one")]
    OtherRecording,
}
