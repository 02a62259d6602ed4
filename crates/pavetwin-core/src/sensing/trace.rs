//! The recorded traffic: any agent's pose at any time, and the agents near a place.

use super::cells::{CellBlock, key_of};
use super::trace_columns::{Body, TraceColumns, TraceError};
use crate::geometry::{Vec2, wrap_angle};

/// Speed above which a displacement between two steps is a teleport of the traffic engine, metres a second. SUMO takes
/// jammed vehicles out and puts them back elsewhere; drawing that as motion would sweep them across the town.
pub const TELEPORT_MPS: f64 = 40.0;

const NONE: u32 = u32::MAX;

/// One agent in one step; 32 bytes, with 8 more in the index.
#[derive(Debug, Clone, Copy)]
struct Row {
    position: Vec2,
    yaw_rad: f32,
    speed_mps: f32,
    agent: u32,
    /// Row of the same agent in the next step, `NONE` when it is absent there or was teleported.
    next: u32,
}

/// Where an agent is at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AgentPose {
    pub agent: u32,
    pub body: Body,
    /// Centre of the body on the ground.
    pub position: Vec2,
    /// Heading, counter-clockwise from east, in (−π, π].
    pub yaw_rad: f64,
    /// Metres a second.
    pub velocity: Vec2,
}

impl AgentPose {
    /// The same agent after `horizon_s` seconds of unchanged velocity.
    pub fn extrapolated(self, horizon_s: f64) -> Self {
        Self { position: self.position + self.velocity * horizon_s, ..self }
    }
}

/// A recording of traffic, valid for times in `[0, duration_s]`.
///
/// Between two steps an agent's position is interpolated linearly and its yaw the shorter way round. An agent that is
/// absent from the next step, or that is farther away there than [`TELEPORT_MPS`] allows, stands at its last pose
/// until the next step begins. Velocity is the difference of the two positions over the step, or where there is no
/// second one, speed along the heading.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    step_s: f64,
    step_offsets: Vec<u32>,
    rows: Vec<Row>,
    bodies: Vec<Body>,
    /// For each step, the hash keys of its rows in ascending order. A row is filed under the middle of its motion.
    cell_keys: Vec<u32>,
    /// The row that each entry of `cell_keys` belongs to.
    cell_rows: Vec<u32>,
    /// For each step, the longest displacement to the next one, metres.
    longest_move_m: Vec<f64>,
    max_half_diagonal_m: f64,
    max_speed_mps: f64,
}

impl Trace {
    /// Checks the columns and builds the index.
    ///
    /// # Errors
    /// The first flaw found in the columns.
    pub fn new(columns: TraceColumns) -> Result<Self, TraceError> {
        columns.check()?;
        Ok(Self::going_on(Self::default(), columns))
    }

    /// As `new`, where the rows of `known` are the first of the columns and so need no work again. Where its steps or
    /// bodies are not the columns' first, everything is computed again.
    ///
    /// # Errors
    /// The first flaw found in the columns.
    pub fn beginning_with(known: &Self, columns: TraceColumns) -> Result<Self, TraceError> {
        columns.check()?;
        let begins = known.step_s == columns.step_s
            && columns.step_offsets.starts_with(&known.step_offsets)
            && columns.bodies.starts_with(&known.bodies);
        Ok(Self::going_on(if begins { known.clone() } else { Self::default() }, columns))
    }

    /// `known` with the rows of the columns that it does not have yet.
    fn going_on(known: Self, columns: TraceColumns) -> Self {
        let mut rows = known.rows;
        rows.extend(rows_of(&columns, rows.len()));
        // The last step that was known had no next one.
        let first = known.longest_move_m.len().saturating_sub(1);
        link_steps(&mut rows, &columns.step_offsets[first..], TELEPORT_MPS * columns.step_s);
        let mut trace = Self {
            step_s: columns.step_s,
            step_offsets: columns.step_offsets,
            max_half_diagonal_m: columns.bodies.iter().map(Body::half_diagonal_m).fold(0.0, f64::max),
            bodies: columns.bodies,
            rows,
            ..known
        };
        trace.build_index(first);
        trace
    }

    /// Time of the last step, seconds.
    pub fn duration_s(&self) -> f64 {
        (self.step_count() - 1) as f64 * self.step_s
    }

    /// Time between two steps, seconds.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    pub fn step_count(&self) -> usize {
        self.step_offsets.len() - 1
    }

    /// Number of rows over all steps.
    pub fn row_count(&self) -> usize {
        self.rows.len()
    }

    /// Sizes, indexed by agent.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// Largest speed in the recording, metres a second.
    pub fn max_speed_mps(&self) -> f64 {
        self.max_speed_mps
    }

    /// The pose of `agent` at `t_s`, `None` while it is not in the traffic.
    ///
    /// # Errors
    /// `PastEnd` or `NotATime` for a time outside the recording.
    pub fn pose(&self, agent: u32, t_s: f64) -> Result<Option<AgentPose>, TraceError> {
        let (step, share) = self.moment(t_s)?;
        let rows = &self.rows[self.rows_of_step(step)];
        let found = rows.binary_search_by_key(&agent, |row| row.agent).ok();
        Ok(found.map(|index| self.pose_of(&rows[index], share)))
    }

    /// Every agent in the traffic at `t_s`, in ascending order of agent.
    ///
    /// # Errors
    /// `PastEnd` or `NotATime` for a time outside the recording.
    pub fn agents_at(&self, t_s: f64) -> Result<impl Iterator<Item = AgentPose>, TraceError> {
        let (step, share) = self.moment(t_s)?;
        Ok(self.rows[self.rows_of_step(step)].iter().map(move |row| self.pose_of(row, share)))
    }

    /// Calls `visit` with exactly those agents whose centre at `t_s` is within `radius_m` plus half their own diagonal
    /// of `centre`, so with every agent that may reach into the disc. The order is that of the index.
    ///
    /// # Errors
    /// `PastEnd` or `NotATime` for a time outside the recording.
    pub fn agents_near(
        &self,
        centre: Vec2,
        radius_m: f64,
        t_s: f64,
        visit: &mut impl FnMut(AgentPose),
    ) -> Result<(), TraceError> {
        let (step, share) = self.moment(t_s)?;
        let rows = self.rows_of_step(step);
        let moved_m = (share - 0.5).abs() * self.longest_move_m[step];
        let half_m = radius_m + self.max_half_diagonal_m + moved_m;
        let corner = Vec2::new(half_m, half_m);
        CellBlock::covering(centre - corner, centre + corner).visit(&self.cell_keys[rows.clone()], |entry| {
            let row = &self.rows[self.cell_rows[rows.start + entry] as usize];
            let offset = self.position_of(row, share) - centre;
            let reach_m = radius_m + self.bodies[row.agent as usize].half_diagonal_m();
            if offset.dot(offset) <= reach_m * reach_m {
                visit(self.pose_of(row, share));
            }
        });
        Ok(())
    }

    /// Whether `other` begins with exactly this recording: same step, same rows, same agents, possibly more of each.
    pub fn is_prefix_of(&self, other: &Self) -> bool {
        let same = |(a, b): (&Row, &Row)| {
            a.agent == b.agent && a.position == b.position && a.yaw_rad == b.yaw_rad && a.speed_mps == b.speed_mps
        };
        self.step_s == other.step_s
            && other.step_offsets.starts_with(&self.step_offsets)
            && other.bodies.starts_with(&self.bodies)
            && self.rows.iter().zip(&other.rows).all(same)
    }

    /// The step at or before `t_s`, and the share of the way to the next.
    fn moment(&self, t_s: f64) -> Result<(usize, f64), TraceError> {
        if t_s.is_nan() || t_s < 0.0 {
            return Err(TraceError::NotATime { t_s });
        }
        if t_s > self.duration_s() {
            return Err(TraceError::PastEnd { t_s, duration_s: self.duration_s() });
        }
        let steps = t_s / self.step_s;
        let step = (steps as usize).min(self.step_count() - 1);
        Ok((step, (steps - step as f64).clamp(0.0, 1.0)))
    }

    fn rows_of_step(&self, step: usize) -> std::ops::Range<usize> {
        self.step_offsets[step] as usize..self.step_offsets[step + 1] as usize
    }

    fn position_of(&self, row: &Row, share: f64) -> Vec2 {
        match self.rows.get(row.next as usize) {
            Some(next) => row.position.lerp(next.position, share),
            None => row.position,
        }
    }

    fn pose_of(&self, row: &Row, share: f64) -> AgentPose {
        let from_rad = f64::from(row.yaw_rad);
        let (position, yaw_rad, velocity) = match self.rows.get(row.next as usize) {
            Some(next) => {
                let moved = next.position - row.position;
                let turn_rad = wrapped(f64::from(next.yaw_rad) - from_rad);
                (row.position + moved * share, from_rad + turn_rad * share, moved * (1.0 / self.step_s))
            }
            None => (row.position, from_rad, Vec2::from_yaw(from_rad) * f64::from(row.speed_mps)),
        };
        let body = self.bodies[row.agent as usize];
        AgentPose { agent: row.agent, body, position, yaw_rad: wrapped(yaw_rad), velocity }
    }

    /// From step `first` on; what comes before is indexed.
    fn build_index(&mut self, first: usize) {
        let indexed = self.step_offsets[first] as usize;
        self.cell_keys.truncate(indexed);
        self.cell_rows.truncate(indexed);
        self.cell_keys.reserve(self.rows.len() - indexed);
        self.cell_rows.reserve(self.rows.len() - indexed);
        self.longest_move_m.truncate(first);
        let mut entries: Vec<(u32, u32)> = Vec::new();
        for step in first..self.step_count() {
            let mut longest_m = 0.0f64;
            entries.clear();
            for index in self.rows_of_step(step) {
                let row = &self.rows[index];
                let moved_m = self.position_of(row, 1.0).distance(row.position);
                longest_m = longest_m.max(moved_m);
                let speed_mps = f64::from(row.speed_mps.abs()).max(moved_m / self.step_s);
                self.max_speed_mps = self.max_speed_mps.max(speed_mps);
                entries.push((key_of(self.position_of(row, 0.5)), index as u32));
            }
            entries.sort_unstable();
            self.longest_move_m.push(longest_m);
            self.cell_keys.extend(entries.iter().map(|entry| entry.0));
            self.cell_rows.extend(entries.iter().map(|entry| entry.1));
        }
    }
}

/// `wrap_angle` without its division for the angles that need none, which are nearly all.
fn wrapped(angle_rad: f64) -> f64 {
    let is_inside = angle_rad > -std::f64::consts::PI && angle_rad <= std::f64::consts::PI;
    if is_inside { angle_rad } else { wrap_angle(angle_rad) }
}

/// The rows from `first` on.
fn rows_of(columns: &TraceColumns, first: usize) -> impl Iterator<Item = Row> {
    (first..columns.agent.len()).map(|row| Row {
        position: Vec2::new(columns.x_m[row], columns.y_m[row]),
        yaw_rad: columns.yaw_rad[row],
        speed_mps: columns.speed_mps[row],
        agent: columns.agent[row],
        next: NONE,
    })
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
