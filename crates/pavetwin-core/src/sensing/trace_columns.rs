//! The columns a recording arrives in, and the check that they describe one.

use super::cells::MAX_COORDINATE_M;
use std::error::Error;
use std::sync::Arc;

/// What kind of dynamic agent a body is; it decides the shape that hides the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyClass {
    /// Hides as a box: length × width at its yaw.
    Vehicle,
    /// Hides as an upright cylinder of diameter `width_m`.
    Pedestrian,
}

/// The size of an agent, which never changes during a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    pub class: BodyClass,
    /// Extent along the heading, metres.
    pub length_m: f64,
    /// Extent across the heading, metres; the diameter of a pedestrian's cylinder.
    pub width_m: f64,
    /// Height of the top above the ground, metres.
    pub height_m: f64,
    /// Height of the underside above the ground, metres: 0 for everything that stands on the road.
    pub base_m: f64,
}

impl Body {
    /// Radius of the circle around the centre that holds the body seen from above, metres.
    pub fn half_diagonal_m(&self) -> f64 {
        0.5 * (self.length_m * self.length_m + self.width_m * self.width_m).sqrt()
    }

    pub(super) fn is_sound(&self) -> bool {
        let sizes = [self.length_m, self.width_m, self.height_m, self.base_m];
        sizes.iter().all(|size| size.is_finite())
            && self.length_m > 0.0
            && self.width_m > 0.0
            && self.base_m >= 0.0
            && self.height_m > self.base_m
    }
}

/// A recording as columns, one row for each agent in each step.
///
/// The rows of step `k` (time `k · step_s`) are `step_offsets[k]..step_offsets[k + 1]`, in ascending order of agent.
#[derive(Debug, Clone, Default)]
pub struct TraceColumns {
    /// Time between two steps, seconds.
    pub step_s: f64,
    /// One more entry than there are steps.
    pub step_offsets: Vec<u32>,
    /// Index into `bodies`.
    pub agent: Vec<u32>,
    /// East of the body's centre, metres.
    pub x_m: Vec<f64>,
    /// North of the body's centre, metres.
    pub y_m: Vec<f64>,
    /// Heading, counter-clockwise from east.
    pub yaw_rad: Vec<f32>,
    /// Speed along the heading, metres a second.
    pub speed_mps: Vec<f32>,
    /// Sizes, indexed by agent.
    pub bodies: Vec<Body>,
}

/// Why a recording cannot be used, or cannot answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TraceError {
    #[error("the time step of a trace must be a positive number of seconds, not {step_s}")]
    Step { step_s: f64 },
    #[error("a trace needs at least one step: give step_offsets one more entry than there are steps")]
    NoSteps,
    #[error("step_offsets must start at 0, never fall and end at the number of rows ({rows}); entry {index} does not")]
    Offsets { index: usize, rows: usize },
    #[error("column {column} has {found} rows where agent has {rows}")]
    Length { column: &'static str, found: usize, rows: usize },
    #[error("row {row} names agent {agent}, but there are {bodies} bodies")]
    UnknownAgent { row: usize, agent: u32, bodies: usize },
    #[error("row {row}: agents must ascend within a step, each at most once")]
    Unsorted { row: usize },
    #[error("row {row}: position, yaw and speed must be finite, and coordinates within ±1000 km")]
    Value { row: usize },
    #[error("the body of agent {agent} needs a positive length and width, and a top above its underside")]
    Body { agent: usize },
    #[error("the time {t_s} s is not a time of a recording: times start at 0")]
    NotATime { t_s: f64 },
    #[error("the time {t_s} s is past the end of the recording ({duration_s} s): record a longer one")]
    PastEnd { t_s: f64, duration_s: f64 },
    #[error("{reason}")]
    Unreadable { reason: String },
    #[error(transparent)]
    Reader(#[from] ReaderError),
}

/// What a reader of parts failed with, unchanged: it is the `source` of every error that comes of it.
#[derive(Debug, Clone)]
pub struct ReaderError(pub Arc<dyn Error + Send + Sync>);

impl PartialEq for ReaderError {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl std::fmt::Display for ReaderError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl Error for ReaderError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        Some(&*self.0)
    }
}

impl TraceColumns {
    /// Whether the columns describe a recording.
    ///
    /// # Errors
    /// The first flaw found, with its row.
    pub fn check(&self) -> Result<(), TraceError> {
        self.check_layout()?;
        for (agent, body) in self.bodies.iter().enumerate() {
            if !body.is_sound() {
                return Err(TraceError::Body { agent });
            }
        }
        for window in self.step_offsets.windows(2) {
            self.check_rows(window[0] as usize..window[1] as usize)?;
        }
        Ok(())
    }

    fn check_layout(&self) -> Result<(), TraceError> {
        let rows = self.agent.len();
        if !(self.step_s.is_finite() && self.step_s > 0.0) {
            return Err(TraceError::Step { step_s: self.step_s });
        }
        if self.step_offsets.len() < 2 {
            return Err(TraceError::NoSteps);
        }
        let lengths = [
            ("x_m", self.x_m.len()),
            ("y_m", self.y_m.len()),
            ("yaw_rad", self.yaw_rad.len()),
            ("speed_mps", self.speed_mps.len()),
        ];
        if let Some(&(column, found)) = lengths.iter().find(|(_, found)| *found != rows) {
            return Err(TraceError::Length { column, found, rows });
        }
        let last = self.step_offsets.len() - 1;
        let falls = self.step_offsets.windows(2).position(|pair| pair[0] > pair[1]).map(|index| index + 1);
        let starts_late = (self.step_offsets[0] != 0).then_some(0);
        let ends_wrong = (self.step_offsets[last] as usize != rows).then_some(last);
        match starts_late.or(falls).or(ends_wrong) {
            Some(index) => Err(TraceError::Offsets { index, rows }),
            None => Ok(()),
        }
    }

    fn check_rows(&self, rows: std::ops::Range<usize>) -> Result<(), TraceError> {
        let mut previous = None;
        for row in rows {
            let agent = self.agent[row];
            if agent as usize >= self.bodies.len() {
                return Err(TraceError::UnknownAgent { row, agent, bodies: self.bodies.len() });
            }
            if previous.is_some_and(|previous| previous >= agent) {
                return Err(TraceError::Unsorted { row });
            }
            previous = Some(agent);
            let placed = self.x_m[row].abs() <= MAX_COORDINATE_M && self.y_m[row].abs() <= MAX_COORDINATE_M;
            if !(placed && self.yaw_rad[row].is_finite() && self.speed_mps[row].is_finite()) {
                return Err(TraceError::Value { row });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car() -> Body {
        Body { class: BodyClass::Vehicle, length_m: 4.5, width_m: 1.8, height_m: 1.5, base_m: 0.0 }
    }

    fn two_steps() -> TraceColumns {
        TraceColumns {
            step_s: 0.5,
            step_offsets: vec![0, 2, 3],
            agent: vec![0, 1, 1],
            x_m: vec![0.0, 5.0, 6.0],
            y_m: vec![0.0; 3],
            yaw_rad: vec![0.0; 3],
            speed_mps: vec![2.0; 3],
            bodies: vec![car(), car()],
        }
    }

    fn flaw(spoil: impl FnOnce(&mut TraceColumns)) -> TraceError {
        let mut columns = two_steps();
        spoil(&mut columns);
        columns.check().expect_err("the spoilt columns passed")
    }

    #[test]
    fn sound_columns_pass() {
        assert_eq!(two_steps().check(), Ok(()));
    }

    #[test]
    fn each_flaw_is_named_with_its_place() {
        assert!(matches!(flaw(|c| c.step_s = 0.0), TraceError::Step { .. }));
        assert!(matches!(flaw(|c| c.step_s = f64::NAN), TraceError::Step { .. }));
        assert_eq!(flaw(|c| c.step_offsets = vec![0]), TraceError::NoSteps);
        assert_eq!(flaw(|c| c.step_offsets[0] = 1), TraceError::Offsets { index: 0, rows: 3 });
        assert_eq!(flaw(|c| c.step_offsets[1] = 9), TraceError::Offsets { index: 2, rows: 3 });
        assert_eq!(flaw(|c| c.step_offsets[2] = 2), TraceError::Offsets { index: 2, rows: 3 });
        assert!(matches!(flaw(|c| c.y_m.truncate(2)), TraceError::Length { column: "y_m", found: 2, rows: 3 }));
        assert!(matches!(flaw(|c| c.agent[2] = 7), TraceError::UnknownAgent { row: 2, agent: 7, bodies: 2 }));
        assert_eq!(flaw(|c| c.agent[1] = 0), TraceError::Unsorted { row: 1 });
        assert_eq!(flaw(|c| c.x_m[1] = f64::INFINITY), TraceError::Value { row: 1 });
        assert_eq!(flaw(|c| c.yaw_rad[0] = f32::NAN), TraceError::Value { row: 0 });
        assert_eq!(flaw(|c| c.bodies[1].height_m = 0.0), TraceError::Body { agent: 1 });
    }
}
