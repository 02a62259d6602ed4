//! What a displaced camera would see of the cells that are hidden now.

use super::camera::{NadirCamera, Viewpoint};
use super::occlusion::{Caster, Scene, SenseError, View};
use super::patch::Patch;
use super::trace::AgentPose;
use crate::geometry::Vec2;

/// Judges viewpoints by the hidden cells they would show, from the agents as they are now, each going on at its present
/// velocity. The recording's future is not looked at. The buffers are reused.
#[derive(Debug, Clone, Default)]
pub struct Predictor {
    agents: Vec<AgentPose>,
    cells: Patch,
    caster: Caster,
    shares: Vec<f64>,
}

impl Predictor {
    pub fn new() -> Self {
        Self::default()
    }

    /// For each of `viewpoints`, the share of the `hidden` cells that would lie in its inspection window with neither a
    /// solid nor an agent before them, `horizon_s` after `t_s`. `None` when no cell is hidden.
    ///
    /// # Errors
    /// For a viewpoint at or below the ground, and a time outside the recording.
    pub fn predict(
        &mut self,
        scene: &Scene,
        camera: &NadirCamera,
        hidden: &Patch,
        viewpoints: &[Viewpoint],
        t_s: f64,
        horizon_s: f64,
    ) -> Result<Option<&[f64]>, SenseError> {
        self.gather(scene, camera, viewpoints, t_s, horizon_s)?;
        let hidden_count = hidden.count();
        if hidden_count == 0 {
            return Ok(None);
        }
        self.shares.clear();
        for viewpoint in viewpoints {
            let shown = self.shown(scene, camera, hidden, viewpoint);
            self.shares.push(f64::from(shown) / f64::from(hidden_count));
        }
        Ok(Some(&self.shares))
    }

    /// The agents that may stand over any of the windows after `horizon_s`, extrapolated.
    fn gather(
        &mut self,
        scene: &Scene,
        camera: &NadirCamera,
        viewpoints: &[Viewpoint],
        t_s: f64,
        horizon_s: f64,
    ) -> Result<(), SenseError> {
        viewpoints.iter().try_for_each(Viewpoint::check)?;
        let centre = viewpoints.first().map_or(Vec2::ZERO, |viewpoint| viewpoint.position);
        let reach = |viewpoint: &Viewpoint| {
            viewpoint.position.distance(centre) + camera.window(viewpoint.altitude_m).half_diagonal_m()
        };
        let reach_m = viewpoints.iter().map(reach).fold(0.0, f64::max);
        let travel_m = scene.trace.max_speed_mps() * horizon_s.abs();
        self.agents.clear();
        scene.trace.agents_near(centre, reach_m + travel_m, t_s, &mut |pose| {
            let later = pose.extrapolated(horizon_s);
            if later.position.distance(centre) <= reach_m + later.body.half_diagonal_m() {
                self.agents.push(later);
            }
        })?;
        Ok(())
    }

    fn shown(&mut self, scene: &Scene, camera: &NadirCamera, hidden: &Patch, viewpoint: &Viewpoint) -> u32 {
        let view = View::new(camera, viewpoint);
        let Self { agents, cells, caster, .. } = self;
        cells.copy_from(hidden);
        caster.retain_unobstructed(cells, &view, scene.solids);
        caster.remove_behind_parked(cells, &view, scene.solids);
        agents.iter().for_each(|pose| caster.remove_hidden(cells, &view, pose));
        cells.count()
    }
}
