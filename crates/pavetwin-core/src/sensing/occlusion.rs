//! Visibility as the design defines it: which cells below the inspection window the camera sees.

use super::camera::{CameraError, NadirCamera, Viewpoint, Window};
use super::grid::SurfaceGrid;
use super::patch::Patch;
use super::raster::Spans;
use super::shadow::{Eye, Shadow};
use super::solids::{Solid, Solids};
use super::trace::{AgentPose, Trace};
use super::trace_columns::{BodyClass, TraceError};
use crate::geometry::Vec2;

/// Why nothing can be seen from there or then.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SenseError {
    #[error(transparent)]
    Trace(#[from] TraceError),
    #[error(transparent)]
    Camera(#[from] CameraError),
}

/// What a camera looks at: a segment's surface among things that stand and things that move.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    pub grid: &'a SurfaceGrid,
    pub solids: &'a Solids,
    pub trace: &'a Trace,
}

/// The result of one look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visibility {
    /// |C|: cells of the segment in the inspection window that nothing which stands still hides.
    pub candidates: u32,
    /// Cells of the segment in the inspection window that a parked vehicle hides, and no other solid.
    pub behind_parked: u32,
    /// |V|: those of them that no agent hides.
    pub visible: u32,
    /// o = |V| / |C|, and 0 when there is no candidate.
    pub share: f64,
    /// Whether C is not empty; where it is empty, `share` says nothing and triggers no policy.
    pub has_candidates: bool,
    /// Mean of the centres of the cells that agents hide, C ∖ V.
    pub hidden_centroid: Option<Vec2>,
}

impl Visibility {
    /// The share that parked vehicles hide of the cells in the window that no other solid hides; 0 where there are none.
    pub fn permanently_hidden(&self) -> f64 {
        f64::from(self.behind_parked) / f64::from((self.candidates + self.behind_parked).max(1))
    }
}

/// What a camera sees of points on the ground, and what hides the others, as shares of the points. A point that several
/// kinds of things hide counts for each of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointShares {
    pub visible: f64,
    /// Behind what is built and grown.
    pub behind_solids: f64,
    pub behind_parked: f64,
    pub behind_vehicles: f64,
    pub behind_pedestrians: f64,
}

const BY_SOLID: u8 = 1;
const BY_VEHICLE: u8 = 2;
const BY_PEDESTRIAN: u8 = 4;
const BY_PARKED: u8 = 8;

/// An inspection window placed on the ground.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    pub(super) eye: Eye,
    pub(super) window: Window,
    pub(super) corners: [Vec2; 4],
    ahead: Vec2,
}

impl View {
    pub(super) fn new(camera: &NadirCamera, viewpoint: &Viewpoint) -> Self {
        let window = camera.window(viewpoint.altitude_m);
        Self {
            eye: eye_of(viewpoint),
            window,
            corners: viewpoint.corners(window),
            ahead: Vec2::from_yaw(viewpoint.yaw_rad),
        }
    }

    /// Whether a body inside a circle may meet the window. None that does not can hide a cell of it: seen from above,
    /// every line of sight to a cell of the window runs inside the window, which is convex and holds the nadir.
    pub(super) fn may_meet(&self, centre: Vec2, radius_m: f64) -> bool {
        let offset = centre - self.eye.nadir;
        offset.dot(self.ahead).abs() <= self.window.half_along_m + radius_m
            && offset.cross(self.ahead).abs() <= self.window.half_across_m + radius_m
    }
}

/// Casts shadows on a patch; the buffers are reused.
#[derive(Debug, Clone, Default)]
pub(super) struct Caster {
    pub(super) spans: Spans,
    pub(super) shadow: Shadow,
}

impl Caster {
    /// Keeps of the patch what lies in the window and no solid hides, parked vehicles aside. Fills on the patch's lattice
    /// from here on.
    pub(super) fn retain_unobstructed(&mut self, patch: &mut Patch, view: &View, solids: &Solids) {
        self.spans.set_lattice(patch.lattice());
        self.spans.polygon(&view.corners);
        patch.retain(&self.spans);
        let (min, max) = bounding_box(&view.corners);
        solids.near(min, max, |solid| self.remove_behind(patch, view, &solid));
    }

    /// Removes what parked vehicles hide.
    pub(super) fn remove_behind_parked(&mut self, patch: &mut Patch, view: &View, solids: &Solids) {
        let (min, max) = bounding_box(&view.corners);
        solids.parked_near(min, max, |vehicle| self.remove_behind(patch, view, &vehicle));
    }

    fn remove_behind(&mut self, patch: &mut Patch, view: &View, solid: &Solid) {
        if view.may_meet(solid.centre, solid.radius_m) {
            self.shadow.of_solid(view.eye, solid);
            self.remove_shadow(patch);
        }
    }

    /// Removes what the agent hides.
    pub(super) fn remove_hidden(&mut self, patch: &mut Patch, view: &View, pose: &AgentPose) {
        if view.may_meet(pose.position, pose.body.half_diagonal_m()) {
            self.shadow.of_agent(view.eye, pose);
            self.remove_shadow(patch);
        }
    }

    fn remove_shadow(&mut self, patch: &mut Patch) {
        if self.shadow.fill(&mut self.spans) {
            patch.remove(&self.spans);
        }
    }
}

fn eye_of(viewpoint: &Viewpoint) -> Eye {
    Eye { nadir: viewpoint.position, altitude_m: viewpoint.altitude_m }
}

fn bounding_box(points: &[Vec2]) -> (Vec2, Vec2) {
    let start = Vec2::new(f64::INFINITY, f64::INFINITY);
    points.iter().fold((start, -start), |(min, max), p| {
        (Vec2::new(min.x.min(p.x), min.y.min(p.y)), Vec2::new(max.x.max(p.x), max.y.max(p.y)))
    })
}

/// Looks at segments. One observer serves one mission: its buffers grow to the size of a window and are then reused.
///
/// A body hides a cell when the line from the camera's centre to the cell's centre meets it: the box of a vehicle, the
/// upright cylinder of diameter `width_m` of a pedestrian, the prism of a solid. A body that reaches higher than the
/// camera is cut just below it, and one that begins above it hides nothing; a camera inside a body sees nothing.
#[derive(Debug, Clone, Default)]
pub struct Observer {
    candidates: Patch,
    visible: Patch,
    hidden: Patch,
    caster: Caster,
    /// Of each point, the kinds of things that hide it, as bits.
    hidden_by: Vec<u8>,
}

impl Observer {
    pub fn new() -> Self {
        Self::default()
    }

    /// Looks at `scene` from `viewpoint` at `t_s`, and keeps the visible and the hidden cells until the next look.
    ///
    /// # Errors
    /// For a viewpoint at or below the ground, and a time outside the recording.
    pub fn observe(
        &mut self,
        scene: &Scene,
        camera: &NadirCamera,
        viewpoint: &Viewpoint,
        t_s: f64,
    ) -> Result<Visibility, SenseError> {
        viewpoint.check()?;
        let view = View::new(camera, viewpoint);
        let Self { candidates, visible, hidden, caster, .. } = self;
        candidates.load(scene.grid, &view.corners);
        caster.retain_unobstructed(candidates, &view, scene.solids);
        let unobstructed_count = candidates.count();
        caster.remove_behind_parked(candidates, &view, scene.solids);
        visible.copy_from(candidates);
        scene.trace.agents_near(viewpoint.position, view.window.half_diagonal_m(), t_s, &mut |pose| {
            caster.remove_hidden(visible, &view, &pose);
        })?;
        hidden.difference(candidates, visible);
        let (candidate_count, visible_count) = (candidates.count(), visible.count());
        Ok(Visibility {
            candidates: candidate_count,
            behind_parked: unobstructed_count - candidate_count,
            visible: visible_count,
            share: f64::from(visible_count) / f64::from(candidate_count.max(1)),
            has_candidates: candidate_count > 0,
            hidden_centroid: hidden.centroid(),
        })
    }

    /// C of the last look.
    pub fn candidates(&self) -> &Patch {
        &self.candidates
    }

    /// V of the last look.
    pub fn visible(&self) -> &Patch {
        &self.visible
    }

    /// C ∖ V of the last look: what agents hid.
    pub fn hidden(&self) -> &Patch {
        &self.hidden
    }

    /// The share of `points` on the ground that nothing hides, see [`Observer::point_shares`].
    ///
    /// # Errors
    /// For a viewpoint at or below the ground, and a time outside the recording.
    pub fn visible_fraction(
        &mut self,
        solids: &Solids,
        trace: &Trace,
        viewpoint: &Viewpoint,
        t_s: f64,
        points: &[Vec2],
    ) -> Result<Option<f64>, SenseError> {
        Ok(self.point_shares(solids, trace, viewpoint, t_s, points)?.map(|shares| shares.visible))
    }

    /// Which shares of `points` on the ground are visible and hidden from `viewpoint` at `t_s`: for a defect given by
    /// points spread over its area, its visible fraction. The frame does not count: points outside it are judged like
    /// any others. `None` when there are no points.
    ///
    /// # Errors
    /// For a viewpoint at or below the ground, and a time outside the recording.
    pub fn point_shares(
        &mut self,
        solids: &Solids,
        trace: &Trace,
        viewpoint: &Viewpoint,
        t_s: f64,
        points: &[Vec2],
    ) -> Result<Option<PointShares>, SenseError> {
        viewpoint.check()?;
        if points.is_empty() {
            return Ok(None);
        }
        let Self { hidden_by, caster: Caster { shadow, .. }, .. } = self;
        let eye = eye_of(viewpoint);
        hidden_by.clear();
        hidden_by.resize(points.len(), 0);
        let mut judge = |shadow: &Shadow, kind: u8| {
            for (kinds, point) in hidden_by.iter_mut().zip(points) {
                if *kinds & kind == 0 && shadow.covers(*point) {
                    *kinds |= kind;
                }
            }
        };
        // Only what stands between the nadir and a point can hide it.
        let (mut min, mut max) = bounding_box(points);
        (min, max) = bounding_box(&[min, max, eye.nadir]);
        solids.near(min, max, |solid| {
            shadow.of_solid(eye, &solid);
            judge(shadow, BY_SOLID);
        });
        solids.parked_near(min, max, |vehicle| {
            shadow.of_solid(eye, &vehicle);
            judge(shadow, BY_PARKED);
        });
        let reach_m = points.iter().map(|point| point.distance(eye.nadir)).fold(0.0, f64::max);
        trace.agents_near(eye.nadir, reach_m, t_s, &mut |pose| {
            shadow.of_agent(eye, &pose);
            judge(shadow, if pose.body.class == BodyClass::Pedestrian { BY_PEDESTRIAN } else { BY_VEHICLE });
        })?;
        let share = |is_meant: &dyn Fn(u8) -> bool| {
            self.hidden_by.iter().filter(|kinds| is_meant(**kinds)).count() as f64 / points.len() as f64
        };
        Ok(Some(PointShares {
            visible: share(&|kinds| kinds == 0),
            behind_solids: share(&|kinds| kinds & BY_SOLID != 0),
            behind_parked: share(&|kinds| kinds & BY_PARKED != 0),
            behind_vehicles: share(&|kinds| kinds & BY_VEHICLE != 0),
            behind_pedestrians: share(&|kinds| kinds & BY_PEDESTRIAN != 0),
        }))
    }
}
