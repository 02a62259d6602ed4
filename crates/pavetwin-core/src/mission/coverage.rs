//! What the camera has seen: cells of each segment, and defects that were swept or are still wanted.

use super::error::FlightError;
use super::event::Sighting;
use super::ground::Ground;
use crate::sensing::{CellSet, NadirCamera, Observer, Scene, Trace, Viewpoint, Visibility};

/// The camera and what is below it at one time.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight<'a> {
    pub ground: &'a Ground,
    pub trace: &'a Trace,
    pub camera: &'a NadirCamera,
    pub viewpoint: Viewpoint,
    pub time_s: f64,
}

#[derive(Debug)]
pub(super) struct Coverage {
    observer: Observer,
    /// Of each segment, the cells seen in captures.
    seen: Vec<Option<CellSet>>,
    /// Of each defect, whether captures should report it.
    wanted: Vec<bool>,
    /// Of each defect, whether its centre was in the moving inspection window.
    swept: Vec<bool>,
}

impl Coverage {
    pub fn new(ground: &Ground) -> Self {
        let (segments, defects) = (ground.segments.len(), ground.defects.len());
        Self {
            observer: Observer::new(),
            seen: vec![None; segments],
            wanted: vec![true; defects],
            swept: vec![false; defects],
        }
    }

    /// o of a segment now.
    pub fn look(&mut self, sight: &Sight, segment: u32) -> Result<Visibility, FlightError> {
        let grid = &sight.ground.segments[segment as usize].grid;
        let scene = Scene { grid, solids: &sight.ground.solids, trace: sight.trace };
        Ok(self.observer.observe(&scene, sight.camera, &sight.viewpoint, sight.time_s)?)
    }

    /// Adds what the last look showed of a segment, and answers the wanted defects in sight.
    pub fn capture(
        &mut self,
        sight: &Sight,
        segment: u32,
        min_visible_fraction: f64,
    ) -> Result<Vec<Sighting>, FlightError> {
        let surface = &sight.ground.segments[segment as usize];
        let seen = self.seen[segment as usize].get_or_insert_with(|| CellSet::empty(&surface.grid));
        seen.insert(self.observer.visible()).expect("the observer looked at this segment's grid");
        let window = sight.camera.placed_window(&sight.viewpoint);
        let mut sightings = Vec::new();
        for &defect in &surface.defects {
            let target = &sight.ground.defects[defect as usize];
            if !self.wanted[defect as usize] || !window.contains(target.centre) {
                continue;
            }
            let (solids, trace) = (&sight.ground.solids, sight.trace);
            let points = target.points().ok_or(FlightError::NotSampled { defect })?;
            let share = self.observer.visible_fraction(solids, trace, &sight.viewpoint, sight.time_s, points)?;
            let visible_fraction = share.unwrap_or(0.0);
            if visible_fraction >= min_visible_fraction {
                sightings.push(Sighting { defect, visible_fraction });
            }
        }
        Ok(sightings)
    }

    /// Marks the defects of a segment whose centre the inspection window passes over.
    pub fn sweep(&mut self, ground: &Ground, camera: &NadirCamera, viewpoint: &Viewpoint, segment: u32) {
        let window = camera.placed_window(viewpoint);
        for &defect in &ground.segments[segment as usize].defects {
            let centre = ground.defects[defect as usize].centre;
            let swept = &mut self.swept[defect as usize];
            *swept = *swept || window.contains(centre);
        }
    }

    /// Share of a segment's cells seen so far.
    pub fn of_surface(&self, ground: &Ground, segment: u32) -> f64 {
        let grid = &ground.segments[segment as usize].grid;
        let seen = self.seen[segment as usize].as_ref();
        seen.map_or(0.0, |cells| cells.count() as f64 / grid.cell_count().max(1) as f64)
    }

    pub fn swept(&self) -> &[bool] {
        &self.swept
    }

    pub fn set_wanted(&mut self, defect: u32, wanted: bool) {
        self.wanted[defect as usize] = wanted;
    }
}
