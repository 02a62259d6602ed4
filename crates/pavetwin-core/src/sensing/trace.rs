//! The recorded traffic: any agent's pose at any time, and the agents near a place.

use super::stretch::{Row, Stretch, wrapped};
use super::trace_columns::{Body, TraceColumns, TraceError};
use crate::geometry::Vec2;
use std::sync::{Arc, Mutex, PoisonError};

/// Rows that are usually held besides those in use, some 130 MB. More were read before and are read again when needed.
pub const HELD_ROWS: usize = 3 << 20;

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

/// Reads a part of a recording by its number.
pub type ReadPart = Box<dyn Fn(usize) -> Result<Stretch, TraceError> + Send + Sync>;

/// A recording in parts, which are read when the clock reaches them.
pub struct TraceParts {
    /// Time between two steps, seconds.
    pub step_s: f64,
    /// The step of the recording that is time 0.
    pub first_step: usize,
    /// From there on.
    pub step_count: usize,
    /// The first step of each part, ascending from 0. A part ends with the first step of the next one, the last part
    /// with the recording, at `first_step + step_count` or later.
    pub starts: Vec<usize>,
    pub read: ReadPart,
    /// Sizes, indexed by agent.
    pub bodies: Vec<Body>,
    /// At least the largest speed in the recording, metres a second.
    pub max_speed_mps: f64,
    /// Rows that are held at most besides those in use, usually [`HELD_ROWS`].
    pub held_rows: usize,
}

/// A recording of traffic, valid for times in `[0, duration_s]`.
///
/// Between two steps an agent's position is interpolated linearly and its yaw the shorter way round. An agent that is
/// absent from the next step, or that is farther away there than [`super::TELEPORT_MPS`] allows, stands at its last
/// pose until the next step begins. Velocity is the difference of the two positions over the step, or where there is no
/// second one, speed along the heading.
pub struct Trace {
    step_s: f64,
    first_step: usize,
    step_count: usize,
    starts: Vec<usize>,
    read: ReadPart,
    bodies: Vec<Body>,
    max_half_diagonal_m: f64,
    max_speed_mps: f64,
    held_rows: usize,
    /// The parts in memory, by number, the last used at the end.
    held: Mutex<Vec<(usize, Arc<Stretch>)>>,
    /// The same value in traces of which one begins with the other.
    lineage: Arc<()>,
}

impl std::fmt::Debug for Trace {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (steps, agents) = (self.step_count, self.bodies.len());
        write!(f, "Trace of {steps} steps of {} s, {agents} agents, {} parts", self.step_s, self.starts.len())
    }
}

impl Trace {
    /// Checks the columns and builds the index.
    ///
    /// # Errors
    /// The first flaw found in the columns.
    pub fn new(columns: TraceColumns) -> Result<Self, TraceError> {
        columns.check()?;
        let stretch = Stretch::of_columns(&columns);
        let parts = TraceParts {
            step_s: columns.step_s,
            first_step: 0,
            step_count: stretch.step_count(),
            starts: vec![0],
            max_speed_mps: stretch.max_speed_mps(columns.step_s),
            read: Box::new(|part| Err(TraceError::Unreadable { reason: format!("there is no part {part}") })),
            bodies: columns.bodies,
            held_rows: HELD_ROWS,
        };
        let trace = Self::of_parts(parts)?;
        trace.hold(0, Arc::new(stretch));
        Ok(trace)
    }

    /// A recording that is read part by part, when it is needed.
    ///
    /// # Errors
    /// The first flaw found in what is not read part by part.
    pub fn of_parts(parts: TraceParts) -> Result<Self, TraceError> {
        let TraceParts { step_s, first_step, step_count, starts, read, bodies, max_speed_mps, held_rows } = parts;
        if !(step_s.is_finite() && step_s > 0.0) {
            return Err(TraceError::Step { step_s });
        }
        if step_count == 0 || starts.first() != Some(&0) || !starts.is_sorted_by(|a, b| a < b) {
            return Err(TraceError::NoSteps);
        }
        if let Some(agent) = bodies.iter().position(|body| !body.is_sound()) {
            return Err(TraceError::Body { agent });
        }
        Ok(Self {
            step_s,
            first_step,
            step_count,
            starts,
            read,
            max_half_diagonal_m: bodies.iter().map(Body::half_diagonal_m).fold(0.0, f64::max),
            max_speed_mps,
            held_rows,
            bodies,
            held: Mutex::default(),
            lineage: Arc::default(),
        })
    }

    /// As `of_parts`, for a recording that begins with all of `known`; the parts that it has in memory stay there.
    ///
    /// # Errors
    /// As `of_parts`.
    pub fn going_on(known: &Self, parts: TraceParts) -> Result<Self, TraceError> {
        let trace = Self::of_parts(parts)?;
        let begins = known.step_s == trace.step_s
            && known.first_step == trace.first_step
            && known.step_count <= trace.step_count
            && trace.starts.starts_with(&known.starts)
            && trace.bodies.starts_with(&known.bodies);
        if !begins {
            return Ok(trace);
        }
        let mut held = known.held.lock().unwrap_or_else(PoisonError::into_inner).clone();
        held.retain(|(part, _)| part + 1 < known.starts.len()); // the last one goes on
        Ok(Self { held: Mutex::new(held), lineage: known.lineage.clone(), ..trace })
    }

    /// Time of the last step, seconds.
    pub fn duration_s(&self) -> f64 {
        (self.step_count - 1) as f64 * self.step_s
    }

    /// Time between two steps, seconds.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    pub fn step_count(&self) -> usize {
        self.step_count
    }

    /// Sizes, indexed by agent.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// At least the largest speed in the recording, metres a second.
    pub fn max_speed_mps(&self) -> f64 {
        self.max_speed_mps
    }

    /// The pose of `agent` at `t_s`, `None` while it is not in the traffic.
    ///
    /// # Errors
    /// `PastEnd` or `NotATime` for a time outside the recording, `Unreadable` where its part cannot be read.
    pub fn pose(&self, agent: u32, t_s: f64) -> Result<Option<AgentPose>, TraceError> {
        let moment = self.moment(t_s)?;
        let rows = moment.stretch.rows_at(moment.step);
        let found = rows.binary_search_by_key(&agent, |row| row.agent).ok();
        Ok(found.map(|index| self.pose_of(&rows[index], &moment)))
    }

    /// Every agent in the traffic at `t_s`, in ascending order of agent.
    ///
    /// # Errors
    /// As `pose`.
    pub fn agents_at(&self, t_s: f64) -> Result<Vec<AgentPose>, TraceError> {
        let moment = self.moment(t_s)?;
        Ok(moment.stretch.rows_at(moment.step).iter().map(|row| self.pose_of(row, &moment)).collect())
    }

    /// Calls `visit` with exactly those agents whose centre at `t_s` is within `radius_m` plus half their own diagonal
    /// of `centre`, so with every agent that may reach into the disc. The order is that of the index.
    ///
    /// # Errors
    /// As `pose`.
    pub fn agents_near(
        &self,
        centre: Vec2,
        radius_m: f64,
        t_s: f64,
        visit: &mut impl FnMut(AgentPose),
    ) -> Result<(), TraceError> {
        let moment = self.moment(t_s)?;
        let half_m = radius_m + self.max_half_diagonal_m;
        moment.stretch.rows_near(moment.step, moment.share, centre, half_m, |row| {
            let offset = moment.stretch.position_of(row, moment.share) - centre;
            let reach_m = radius_m + self.bodies[row.agent as usize].half_diagonal_m();
            if offset.dot(offset) <= reach_m * reach_m {
                visit(self.pose_of(row, &moment));
            }
        });
        Ok(())
    }

    /// Whether `other` begins with exactly this recording: same step, same rows, same agents, possibly more of each.
    ///
    /// # Errors
    /// `Unreadable` where a part of either cannot be read.
    pub fn is_prefix_of(&self, other: &Self) -> Result<bool, TraceError> {
        let begins = self.step_s == other.step_s
            && self.step_count <= other.step_count
            && other.bodies.starts_with(&self.bodies);
        if !begins || Arc::ptr_eq(&self.lineage, &other.lineage) {
            return Ok(begins);
        }
        for step in 0..self.step_count {
            let (step, theirs) = (step + self.first_step, step + other.first_step);
            let (mine, its) = (self.stretch_of(step)?, other.stretch_of(theirs)?);
            let (rows, others) = (mine.rows_at(step), its.rows_at(theirs));
            if rows.len() != others.len() || !rows.iter().zip(others).all(|(a, b)| a.is_as(b)) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The step at or before `t_s`, and the share of the way to the next.
    fn moment(&self, t_s: f64) -> Result<Moment, TraceError> {
        if t_s.is_nan() || t_s < 0.0 {
            return Err(TraceError::NotATime { t_s });
        }
        if t_s > self.duration_s() {
            return Err(TraceError::PastEnd { t_s, duration_s: self.duration_s() });
        }
        let steps = t_s / self.step_s;
        let step = (steps as usize).min(self.step_count - 1);
        let share = (steps - step as f64).clamp(0.0, 1.0);
        let (is_end, step) = (step + 1 == self.step_count, step + self.first_step);
        Ok(Moment { stretch: self.stretch_of(step)?, step, share, is_end })
    }

    /// The part that tells where agents are between a step of the recording and the next.
    fn stretch_of(&self, step: usize) -> Result<Arc<Stretch>, TraceError> {
        let part = self.starts.partition_point(|start| *start <= step) - 1;
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = held.iter().rposition(|(number, _)| *number == part) {
            let found = held[at].1.clone();
            held[at..].rotate_left(1);
            return Ok(found);
        }
        drop(held); // reading may wait for others who ask for a pose meanwhile
        let stretch = Arc::new((self.read)(part)?);
        let covered = stretch.first_step()..stretch.first_step() + stretch.step_count();
        if stretch.first_step() != self.starts[part] || !covered.contains(&step) {
            return Err(TraceError::Unreadable { reason: format!("part {part} of the recording is missing step {step}") });
        }
        self.hold(part, stretch.clone());
        Ok(stretch)
    }

    fn hold(&self, part: usize, stretch: Arc<Stretch>) {
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        held.retain(|(number, _)| *number != part);
        let mut rows: usize = held.iter().map(|(_, other)| other.row_count()).sum();
        while rows > self.held_rows {
            rows -= held.remove(0).1.row_count();
        }
        held.push((part, stretch));
    }

    fn pose_of(&self, row: &Row, moment: &Moment) -> AgentPose {
        let from_rad = f64::from(row.yaw_rad);
        let next = if moment.is_end { None } else { moment.stretch.next(row) };
        let (position, yaw_rad, velocity) = match next {
            Some(next) => {
                let moved = next.position - row.position;
                let turn_rad = wrapped(f64::from(next.yaw_rad) - from_rad);
                let share = moment.share;
                (row.position + moved * share, from_rad + turn_rad * share, moved * (1.0 / self.step_s))
            }
            None => (row.position, from_rad, Vec2::from_yaw(from_rad) * f64::from(row.speed_mps)),
        };
        let body = self.bodies[row.agent as usize];
        AgentPose { agent: row.agent, body, position, yaw_rad: wrapped(yaw_rad), velocity }
    }
}

/// A time of a recording.
struct Moment {
    stretch: Arc<Stretch>,
    /// Of the recording, at or before the time.
    step: usize,
    /// Of the way to the next step.
    share: f64,
    /// Whether the trace ends here, though its recording may go on.
    is_end: bool,
}
