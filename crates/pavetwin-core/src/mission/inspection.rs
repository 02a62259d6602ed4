//! The inspection in progress: of what, along which line, and when the next look and the next capture are due.

use crate::geometry::Vec2;

#[derive(Debug, Clone)]
pub(super) struct Inspection {
    pub segment: u32,
    pub on_revisit: bool,
    /// The corners of the line under inspection, up to its end; none on a revisit.
    pub line: Vec<Vec2>,
    next_look_tick: u64,
    next_capture_tick: u64,
}

impl Inspection {
    /// Begins with a look and a capture at the end of the next step.
    pub fn along(segment: u32, line: Vec<Vec2>, tick: u64) -> Self {
        Self { segment, on_revisit: false, line, next_look_tick: tick, next_capture_tick: tick }
    }

    pub fn revisit(segment: u32, tick: u64) -> Self {
        Self { on_revisit: true, ..Self::along(segment, Vec::new(), tick) }
    }

    /// Goes on with another segment, at the same intervals.
    pub fn turn_to(&mut self, segment: u32) {
        self.segment = segment;
    }

    /// Brings the next look forward.
    pub fn look_at(&mut self, tick: u64) {
        self.next_look_tick = self.next_look_tick.min(tick);
    }

    /// Brings the next capture forward.
    pub fn capture_at(&mut self, tick: u64) {
        self.next_capture_tick = self.next_capture_tick.min(tick);
    }

    pub fn capture_is_due(&self, tick: u64) -> bool {
        tick >= self.next_capture_tick
    }

    /// Every capture is a look too.
    pub fn look_is_due(&self, tick: u64) -> bool {
        tick >= self.next_look_tick || self.capture_is_due(tick)
    }

    /// Sets when the next look and, after a capture, the next capture are due.
    pub fn looked(&mut self, tick: u64, look_steps: u32, capture_steps: u32) {
        if self.capture_is_due(tick) {
            self.next_capture_tick = tick + u64::from(capture_steps);
        }
        self.next_look_tick = tick + u64::from(look_steps);
    }
}
