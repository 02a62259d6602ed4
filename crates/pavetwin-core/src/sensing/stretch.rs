//! The rows of consecutive steps of a recording, with an index of where they are.

use super::cells::{CellBlock, MAX_COORDINATE_M, key_of};
use super::trace_columns::{TraceColumns, TraceError};
use crate::geometry::{Vec2, wrap_angle};
use std::ops::Range;

/// Speed above which a displacement between two steps is a teleport of the traffic engine, metres a second. SUMO takes
/// jammed vehicles out and puts them back elsewhere; drawing that as motion would sweep them across the town.
pub const TELEPORT_MPS: f64 = 40.0;

const NONE: u32 = u32::MAX;

/// One agent in one step; 32 bytes, with 8 more in the index.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub position: Vec2,
    pub yaw_rad: f32,
    pub speed_mps: f32,
    pub agent: u32,
    /// Row of the same agent in the next step, `NONE` when it is absent there or was teleported.
    next: u32,
}

impl Row {
    pub fn is_as(&self, other: &Self) -> bool {
        self.agent == other.agent
            && self.position == other.position
            && self.yaw_rad == other.yaw_rad
            && self.speed_mps == other.speed_mps
    }
}

/// The poses of agents over some steps, without those that follow from others: between two key frames of an agent its
/// position, heading (the shorter way round) and speed change evenly.
///
/// The columns have one entry a key frame, in ascending order of (agent, step).
#[derive(Debug, Clone, Copy)]
pub struct KeyFrames<'a> {
    /// The steps that are covered, both included.
    pub first_step: u32,
    pub last_step: u32,
    pub agent: &'a [u32],
    pub step: &'a [u32],
    /// East of the body's centre, metres.
    pub x_m: &'a [f32],
    /// North of the body's centre, metres.
    pub y_m: &'a [f32],
    /// Heading, counter-clockwise from east.
    pub yaw_rad: &'a [f32],
    /// Speed along the heading, metres a second.
    pub speed_mps: &'a [f32],
    /// Whether the agent is absent after this step, until its next key frame.
    pub is_last: &'a [bool],
}

impl KeyFrames<'_> {
    fn check(&self, agents: usize) -> Result<(), TraceError> {
        let rows = self.agent.len();
        for (column, found) in [
            ("step", self.step.len()),
            ("x_m", self.x_m.len()),
            ("y_m", self.y_m.len()),
            ("yaw_rad", self.yaw_rad.len()),
            ("speed_mps", self.speed_mps.len()),
            ("is_last", self.is_last.len()),
        ] {
            if found != rows {
                return Err(TraceError::Length { column, found, rows });
            }
        }
        let steps = self.first_step..=self.last_step;
        for row in 0..rows {
            let (agent, step) = (self.agent[row], self.step[row]);
            if agent as usize >= agents {
                return Err(TraceError::UnknownAgent { row, agent, bodies: agents });
            }
            let follows = row == 0 || (self.agent[row - 1], self.step[row - 1]) < (agent, step);
            if !follows || !steps.contains(&step) {
                return Err(TraceError::Unsorted { row });
            }
            let is_placed = self.x_m[row].abs() <= MAX_COORDINATE_M as f32
                && self.y_m[row].abs() <= MAX_COORDINATE_M as f32
                && self.yaw_rad[row].is_finite()
                && self.speed_mps[row].is_finite();
            if !is_placed {
                return Err(TraceError::Value { row });
            }
        }
        Ok(())
    }

    /// The steps from a key frame on, up to the agent's next key frame, if it is there in between.
    fn steps_of(&self, key: usize) -> Range<usize> {
        let step = self.step[key] as usize;
        step..if self.goes_on(key) { self.step[key + 1] as usize } else { step + 1 }
    }

    fn goes_on(&self, key: usize) -> bool {
        !self.is_last[key] && self.agent.get(key + 1) == Some(&self.agent[key])
    }

    fn row(&self, key: usize, step: usize) -> Row {
        let position = |key: usize| Vec2::new(f64::from(self.x_m[key]), f64::from(self.y_m[key]));
        let row = Row {
            position: position(key),
            yaw_rad: self.yaw_rad[key],
            speed_mps: self.speed_mps[key],
            agent: self.agent[key],
            next: NONE,
        };
        let passed = step - self.step[key] as usize;
        if passed == 0 {
            return row;
        }
        let share = passed as f64 / f64::from(self.step[key + 1] - self.step[key]);
        let turn_rad = wrapped(f64::from(self.yaw_rad[key + 1]) - f64::from(row.yaw_rad));
        let gain_mps = f64::from(self.speed_mps[key + 1]) - f64::from(row.speed_mps);
        Row {
            position: row.position.lerp(position(key + 1), share),
            yaw_rad: (f64::from(row.yaw_rad) + turn_rad * share) as f32,
            speed_mps: (f64::from(row.speed_mps) + gain_mps * share) as f32,
            ..row
        }
    }
}

/// Some consecutive steps of a recording.
#[derive(Debug, Clone, Default)]
pub struct Stretch {
    /// Of the recording.
    first_step: usize,
    step_offsets: Vec<u32>,
    rows: Vec<Row>,
    /// For each step, the hash keys of its rows in ascending order. A row is filed under the middle of its motion.
    cell_keys: Vec<u32>,
    /// The row that each entry of `cell_keys` belongs to.
    cell_rows: Vec<u32>,
    /// For each step, the longest displacement to the next one, metres.
    longest_move_m: Vec<f64>,
}

impl Stretch {
    /// The rows of columns that are checked, from step 0 on.
    pub(super) fn of_columns(columns: &TraceColumns) -> Self {
        let rows = (0..columns.agent.len()).map(|row| Row {
            position: Vec2::new(columns.x_m[row], columns.y_m[row]),
            yaw_rad: columns.yaw_rad[row],
            speed_mps: columns.speed_mps[row],
            agent: columns.agent[row],
            next: NONE,
        });
        let mut rows: Vec<Row> = rows.collect();
        link_steps(&mut rows, &columns.step_offsets, TELEPORT_MPS * columns.step_s);
        Self { step_offsets: columns.step_offsets.clone(), rows, ..Self::default() }.indexed()
    }

    /// The rows between key frames.
    ///
    /// # Errors
    /// The first flaw found in the key frames.
    pub fn of_key_frames(keys: &KeyFrames<'_>, agents: usize, step_s: f64) -> Result<Self, TraceError> {
        keys.check(agents)?;
        let first_step = keys.first_step as usize;
        let count = keys.last_step as usize - first_step + 1;
        let mut step_offsets = vec![0u32; count + 1];
        for key in 0..keys.agent.len() {
            keys.steps_of(key).for_each(|step| step_offsets[step - first_step + 1] += 1);
        }
        for step in 0..count {
            step_offsets[step + 1] += step_offsets[step];
        }
        let blank = Row { position: Vec2::ZERO, yaw_rad: 0.0, speed_mps: 0.0, agent: 0, next: NONE };
        let mut rows = vec![blank; step_offsets[count] as usize];
        let mut free = step_offsets.clone();
        let mut before: Option<usize> = None;
        for key in 0..keys.agent.len() {
            for step in keys.steps_of(key) {
                let at = free[step - first_step] as usize;
                free[step - first_step] += 1;
                rows[at] = keys.row(key, step);
                if let Some(before) = before
                    && rows[before].position.distance(rows[at].position) <= TELEPORT_MPS * step_s
                {
                    rows[before].next = at as u32;
                }
                before = Some(at);
            }
            before = before.filter(|_| keys.goes_on(key));
        }
        Ok(Self { first_step, step_offsets, rows, ..Self::default() }.indexed())
    }

    pub(super) fn first_step(&self) -> usize {
        self.first_step
    }

    pub(super) fn step_count(&self) -> usize {
        self.step_offsets.len() - 1
    }

    pub(super) fn row_count(&self) -> usize {
        self.rows.len()
    }

    /// The rows of a step of the recording, in ascending order of agent.
    pub(super) fn rows_at(&self, step: usize) -> &[Row] {
        &self.rows[self.rows_of_step(step - self.first_step)]
    }

    /// The same agent in the next step, unless it is absent there or was teleported.
    pub(super) fn next(&self, row: &Row) -> Option<&Row> {
        self.rows.get(row.next as usize)
    }

    pub(super) fn position_of(&self, row: &Row, share: f64) -> Vec2 {
        match self.next(row) {
            Some(next) => row.position.lerp(next.position, share),
            None => row.position,
        }
    }

    /// Calls `visit` with at least the rows of a step whose position, that share of the way to the next step, is
    /// within the square around `centre`.
    pub(super) fn rows_near(&self, step: usize, share: f64, centre: Vec2, half_m: f64, mut visit: impl FnMut(&Row)) {
        let step = step - self.first_step;
        let rows = self.rows_of_step(step);
        let half_m = half_m + (share - 0.5).abs() * self.longest_move_m[step];
        let corner = Vec2::new(half_m, half_m);
        CellBlock::covering(centre - corner, centre + corner).visit(&self.cell_keys[rows.clone()], |entry| {
            visit(&self.rows[self.cell_rows[rows.start + entry] as usize]);
        });
    }

    /// The largest speed and displacement over time of an agent, metres a second.
    pub(super) fn max_speed_mps(&self, step_s: f64) -> f64 {
        let longest_m = self.longest_move_m.iter().copied().fold(0.0, f64::max);
        self.rows.iter().map(|row| f64::from(row.speed_mps.abs())).fold(longest_m / step_s, f64::max)
    }

    fn rows_of_step(&self, step: usize) -> Range<usize> {
        self.step_offsets[step] as usize..self.step_offsets[step + 1] as usize
    }

    fn indexed(mut self) -> Self {
        self.cell_keys.reserve(self.rows.len());
        self.cell_rows.reserve(self.rows.len());
        let mut entries: Vec<(u32, u32)> = Vec::new();
        for step in 0..self.step_count() {
            let mut longest_m = 0.0f64;
            entries.clear();
            for index in self.rows_of_step(step) {
                let row = &self.rows[index];
                longest_m = longest_m.max(self.position_of(row, 1.0).distance(row.position));
                entries.push((key_of(self.position_of(row, 0.5)), index as u32));
            }
            entries.sort_unstable();
            self.longest_move_m.push(longest_m);
            self.cell_keys.extend(entries.iter().map(|entry| entry.0));
            self.cell_rows.extend(entries.iter().map(|entry| entry.1));
        }
        self
    }
}

/// `wrap_angle` without its division for the angles that need none, which are nearly all.
pub(super) fn wrapped(angle_rad: f64) -> f64 {
    let is_inside = angle_rad > -std::f64::consts::PI && angle_rad <= std::f64::consts::PI;
    if is_inside { angle_rad } else { wrap_angle(angle_rad) }
}

/// Points every row at the same agent's row in the next step, unless the way there is longer than `longest_m`.
fn link_steps(rows: &mut [Row], step_offsets: &[u32], longest_m: f64) {
    for bounds in step_offsets.windows(3) {
        let mut next = bounds[1] as usize;
        for index in bounds[0] as usize..bounds[1] as usize {
            let row = rows[index];
            while next < bounds[2] as usize && rows[next].agent < row.agent {
                next += 1;
            }
            if next < bounds[2] as usize
                && rows[next].agent == row.agent
                && rows[next].position.distance(row.position) <= longest_m
            {
                rows[index].next = next as u32;
            }
        }
    }
}
