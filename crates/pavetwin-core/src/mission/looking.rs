//! Looking while inspecting: visibility, captures, sightings, episodes of occlusion.

use super::event::{Capture, Event, OcclusionReport, Sighting};
use super::flight::{Flight, FlightError, Task};
use super::log::TrackRow;
use super::reaction::{Episode, Reaction};
use crate::sensing::{CellSet, Scene, Visibility};

/// What is under inspection, and when it is looked at next.
#[derive(Debug, Clone, Copy)]
pub(super) struct Inspection {
    pub segment: u32,
    pub on_revisit: bool,
    pub next_look_tick: u64,
    pub next_capture_tick: u64,
}

impl Flight {
    /// Brings the next look forward to the end of this step.
    pub(super) fn look_again(&mut self) {
        let tick = self.tick + 1;
        if let Some(inspection) = &mut self.inspection {
            inspection.next_look_tick = inspection.next_look_tick.min(tick);
        }
    }

    /// Brings the next capture forward to the end of this step.
    pub(super) fn capture_now(&mut self) {
        let tick = self.tick + 1;
        if let Some(inspection) = &mut self.inspection {
            inspection.next_capture_tick = inspection.next_capture_tick.min(tick);
        }
    }

    /// Everything that is due now: the sweep, a look, a capture, a row of the track.
    pub(super) fn look_if_due(&mut self) -> Result<(), FlightError> {
        self.sweep();
        let Some(inspection) = self.inspection else {
            self.log_if_due(None);
            return Ok(());
        };
        let capture_due = self.tick >= inspection.next_capture_tick;
        if !capture_due && self.tick < inspection.next_look_tick {
            return Ok(());
        }
        let visibility = self.look(inspection.segment)?;
        if capture_due {
            self.capture(inspection, &visibility)?;
        }
        let next_look_tick = self.tick + u64::from(self.settings.look_steps);
        let next_capture_tick =
            if capture_due { self.tick + u64::from(self.settings.capture_steps) } else { inspection.next_capture_tick };
        self.inspection = Some(Inspection { next_look_tick, next_capture_tick, ..inspection });
        self.judge(inspection, &visibility);
        self.next_log_tick = self.tick;
        self.log_if_due(Some(&visibility));
        Ok(())
    }

    fn look(&mut self, segment: u32) -> Result<Visibility, FlightError> {
        let grid = &self.ground.segments[segment as usize].grid;
        let scene = Scene { grid, solids: &self.ground.solids, trace: &self.trace };
        let viewpoint = self.viewpoint();
        Ok(self.observer.observe(&scene, &self.settings.camera, &viewpoint, self.time_s())?)
    }

    fn capture(&mut self, inspection: Inspection, visibility: &Visibility) -> Result<(), FlightError> {
        let segment = inspection.segment as usize;
        let grid = &self.ground.segments[segment].grid;
        let seen = self.seen[segment].get_or_insert_with(|| CellSet::empty(grid));
        seen.insert(self.observer.visible()).expect("the observer looked at this segment's grid");
        let (viewpoint, time_s) = (self.viewpoint(), self.time_s());
        let number = self.captures.time_s.len() as u32;
        self.captures.time_s.push(time_s);
        self.captures.x_m.push(viewpoint.position.x);
        self.captures.y_m.push(viewpoint.position.y);
        self.captures.yaw_rad.push(viewpoint.yaw_rad);
        self.captures.segment.push(inspection.segment as i32);
        self.captures.visibility.push(if visibility.has_candidates { visibility.share } else { f64::NAN });
        self.captures.on_revisit.push(inspection.on_revisit);
        let mut sightings = Vec::new();
        for &defect in &self.ground.segments[segment].defects {
            let target = &self.ground.defects[defect as usize];
            if !self.wanted[defect as usize] || !self.settings.camera.window_contains(&viewpoint, target.centre) {
                continue;
            }
            let (solids, trace) = (&self.ground.solids, &self.trace);
            let share = self.observer.visible_fraction(solids, trace, &viewpoint, time_s, &target.points)?;
            let visible_fraction = share.unwrap_or(0.0);
            if visible_fraction >= self.settings.min_visible_fraction {
                sightings.push(Sighting { defect, visible_fraction });
            }
        }
        if self.settings.every_capture || !sightings.is_empty() {
            self.queue.push_back(Event::Captured(Capture {
                number,
                time_s,
                viewpoint,
                velocity_mps: self.velocity_mps(),
                segment: inspection.segment,
                on_revisit: inspection.on_revisit,
                visibility: visibility.has_candidates.then_some(visibility.share),
                sightings,
            }));
        }
        Ok(())
    }

    /// Opens or closes the episode of occlusion, and reports what needs deciding.
    fn judge(&mut self, inspection: Inspection, visibility: &Visibility) {
        let busy = inspection.on_revisit || self.encounter.is_some() || !matches!(self.reaction, Reaction::None);
        if busy || !matches!(self.task, Task::Rail(_)) || !visibility.has_candidates {
            return;
        }
        if visibility.share >= self.settings.threshold {
            self.episode = None;
            return;
        }
        if self.episode.is_none() {
            self.occlusions += 1;
        }
        let fresh =
            Episode { since_tick: self.tick, waited_ticks: 0, displacements: 0, displaced_at_m: f64::NEG_INFINITY };
        let episode = *self.episode.get_or_insert(fresh);
        let dt_s = self.settings.time_step_s;
        self.queue.push_back(Event::Occluded(OcclusionReport {
            time_s: self.time_s(),
            visibility: visibility.share,
            hidden_centroid: visibility.hidden_centroid,
            since_s: episode.since_tick as f64 * dt_s,
            waited_s: episode.waited_ticks as f64 * dt_s,
            displacements: episode.displacements,
            since_displacement_m: self.distance_m - episode.displaced_at_m,
        }));
    }

    /// Marks the defects whose centre the window passes over.
    fn sweep(&mut self) {
        let Some(inspection) = self.inspection else { return };
        let viewpoint = self.viewpoint();
        for &defect in &self.ground.segments[inspection.segment as usize].defects {
            let centre = self.ground.defects[defect as usize].centre;
            let swept = &mut self.swept[defect as usize];
            *swept = *swept || self.settings.camera.window_contains(&viewpoint, centre);
        }
    }

    pub(super) fn log_if_due(&mut self, visibility: Option<&Visibility>) {
        if self.tick < self.next_log_tick {
            return;
        }
        self.next_log_tick = self.tick + u64::from(self.settings.look_steps);
        self.track.push(&TrackRow {
            time_s: self.time_s(),
            viewpoint: self.viewpoint(),
            speed_mps: self.speed_mps,
            battery: self.battery,
            mode: self.mode,
            segment: self.inspection.map(|inspection| inspection.segment),
            visibility: visibility.filter(|look| look.has_candidates).map(|look| look.share),
        });
    }
}
