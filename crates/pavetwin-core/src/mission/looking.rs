//! What is due at the end of a time step: the sweep, a look, a capture, a row of the track.

use super::coverage::Sight;
use super::error::FlightError;
use super::event::{Capture, Event};
use super::flight::Flight;
use super::log::{CaptureRow, TrackRow};
use super::task::Task;
use crate::sensing::Visibility;

impl Flight {
    pub(super) fn look_if_due(&mut self) -> Result<(), FlightError> {
        let (tick, viewpoint, time_s) = (self.clock.tick, self.uav.viewpoint(), self.clock.time_s());
        let Self { ground, trace, settings, coverage, .. } = self;
        let Some(inspection) = &mut self.inspection else {
            self.log_if_due(None);
            return Ok(());
        };
        let (segment, on_revisit) = (inspection.segment, inspection.on_revisit);
        coverage.sweep(ground, &settings.camera, &viewpoint, segment);
        if !inspection.look_is_due(tick) {
            return Ok(());
        }
        let is_capture = inspection.capture_is_due(tick);
        inspection.looked(tick, settings.look_steps, settings.capture_steps);
        let sight = Sight { ground, trace, camera: &settings.camera, viewpoint, time_s };
        let look = coverage.look(&sight, segment)?;
        let visibility = look.has_candidates.then_some(look.share);
        if is_capture {
            let sightings = coverage.capture(&sight, segment, settings.min_visible_fraction)?;
            let number = self.log.captures.push(&CaptureRow { time_s, viewpoint, segment, visibility, on_revisit });
            if settings.every_capture || !sightings.is_empty() {
                self.events.push_back(Event::Captured(Capture {
                    number,
                    time_s,
                    viewpoint,
                    velocity_mps: self.velocity_mps(),
                    segment,
                    on_revisit,
                    visibility,
                    sightings,
                }));
            }
        }
        self.judge(&look, on_revisit);
        self.log.next_row_tick = tick;
        self.log_if_due(visibility);
        Ok(())
    }

    /// Opens or closes the episode of occlusion, and reports what needs deciding.
    fn judge(&mut self, look: &Visibility, on_revisit: bool) {
        let is_busy = on_revisit || self.encounter.is_some() || !self.reaction.is_none();
        let is_under_way = self.task.follower().is_some() || matches!(self.task, Task::Steer(_));
        if is_busy || !is_under_way || !look.has_candidates {
            return;
        }
        if look.share >= self.settings.threshold {
            self.occlusions.end_episode();
        } else {
            let report = self.occlusions.report(look, &self.clock, self.odometer_m);
            self.events.push_back(Event::Occluded(report));
        }
    }

    /// Adds a row to the track, with o when something was looked at.
    pub(super) fn log_if_due(&mut self, visibility: Option<f64>) {
        if self.clock.tick < self.log.next_row_tick {
            return;
        }
        self.log.next_row_tick = self.clock.tick + u64::from(self.settings.look_steps);
        self.log.track.push(&TrackRow {
            time_s: self.time_s(),
            viewpoint: self.viewpoint(),
            speed_mps: self.uav.speed_mps,
            battery: self.charge.left,
            mode: self.mode,
            segment: self.inspection.as_ref().map(|inspection| inspection.segment),
            visibility,
        });
    }
}
