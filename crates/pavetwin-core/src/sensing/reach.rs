//! What a camera can see of a surface at best, when nothing moves: the bound that parked vehicles set.

use super::camera::{NadirCamera, Viewpoint};
use super::cell_set::CellSet;
use super::grid::SurfaceGrid;
use super::occlusion::{Caster, SenseError, View};
use super::patch::Patch;
use super::solids::Solids;

/// What the inspection windows of several viewpoints show together of a segment without traffic.
#[derive(Debug, Clone)]
pub struct Reach {
    unobstructed: CellSet,
    visible: CellSet,
}

impl Reach {
    /// Looks from all of `viewpoints`.
    ///
    /// # Errors
    /// For a viewpoint at or below the ground.
    pub fn of(
        grid: &SurfaceGrid,
        solids: &Solids,
        camera: &NadirCamera,
        viewpoints: &[Viewpoint],
    ) -> Result<Self, SenseError> {
        let mut reach = Self { unobstructed: CellSet::empty(grid), visible: CellSet::empty(grid) };
        let (mut patch, mut caster) = (Patch::default(), Caster::default());
        for viewpoint in viewpoints {
            viewpoint.check()?;
            let view = View::new(camera, viewpoint);
            patch.load(grid, &view.corners);
            caster.retain_unobstructed(&mut patch, &view, solids);
            reach.unobstructed.insert(&patch).expect("the patch is of this grid");
            caster.remove_behind_parked(&mut patch, &view, solids);
            reach.visible.insert(&patch).expect("the patch is of this grid");
        }
        Ok(reach)
    }

    /// The cells that some viewpoint sees.
    pub fn visible(&self) -> &CellSet {
        &self.visible
    }

    /// The cells that some viewpoint would see if nothing were parked, and none sees.
    pub fn permanently_hidden(&self) -> CellSet {
        self.unobstructed.without(&self.visible)
    }
}
