//! The mission's clock: whole time steps since the beginning of the recording.

/// A moment this little after a time step, in steps, is that step.
const SAME_STEP: f64 = 1.0e-6;

#[derive(Debug, Clone, Copy)]
pub(super) struct Clock {
    pub tick: u64,
    pub step_s: f64,
}

impl Clock {
    pub fn new(step_s: f64) -> Self {
        Self { tick: 0, step_s }
    }

    pub fn time_s(&self) -> f64 {
        self.seconds(self.tick)
    }

    /// The time after the next step.
    pub fn next_s(&self) -> f64 {
        self.seconds(self.tick + 1)
    }

    pub fn seconds(&self, ticks: u64) -> f64 {
        ticks as f64 * self.step_s
    }

    /// A span of time in steps, rounded.
    pub fn ticks(&self, seconds: f64) -> u64 {
        (seconds / self.step_s).round().max(0.0) as u64
    }

    /// The first step at or after a moment.
    pub fn first_tick_at(&self, time_s: f64) -> u64 {
        (time_s / self.step_s - SAME_STEP).ceil().max(0.0) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_between_two_steps_is_reached_by_the_later_one() {
        let clock = Clock::new(0.05);
        assert_eq!(clock.first_tick_at(0.3), 6);
        assert_eq!(clock.first_tick_at(0.31), 7);
        assert_eq!(clock.first_tick_at(-1.0), 0);
        assert_eq!(clock.first_tick_at(f64::INFINITY), u64::MAX);
    }

    #[test]
    fn spans_are_rounded_to_whole_steps() {
        let clock = Clock::new(0.05);
        assert_eq!(clock.ticks(2.0), 40);
        assert_eq!(clock.ticks(0.07), 1);
        assert_eq!(clock.ticks(-0.3), 0);
    }
}
