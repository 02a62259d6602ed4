//! Predicted visibility after displacements from one state of a mission. Everything in it is immutable, so it can be
//! asked at any later time.

use super::ground::Ground;
use crate::geometry::Vec2;
use crate::navigation::Limits;
use crate::sensing::{NadirCamera, Observer, Predictor, Scene, SenseError, Trace, Viewpoint};
use std::sync::Arc;

/// The marks of a displacement that leaves the mesh.
pub const UNREACHABLE: f64 = -1.0;

/// The state at one time, as far as a prediction needs it.
#[derive(Debug, Clone)]
pub struct DisplacementPredictor {
    pub(super) ground: Arc<Ground>,
    pub(super) trace: Arc<Trace>,
    pub(super) camera: NadirCamera,
    pub(super) limits: Limits,
    pub(super) viewpoint: Viewpoint,
    /// Where braking would end.
    pub(super) rest: Vec2,
    pub(super) speed_mps: f64,
    pub(super) segment: u32,
    pub(super) time_s: f64,
}

impl DisplacementPredictor {
    /// For each displacement from where braking would end, the predicted visible share of the cells now hidden: each
    /// agent goes on at its present velocity for as long as braking and moving take. [`UNREACHABLE`] when the straight
    /// way leaves the mesh; 0 when nothing is hidden.
    ///
    /// # Errors
    /// Never for a time inside the recording.
    pub fn predict(&self, displacements: &[Vec2]) -> Result<Vec<f64>, SenseError> {
        let grid = &self.ground.segments[self.segment as usize].grid;
        let scene = Scene { grid, solids: &self.ground.solids, trace: &self.trace };
        let (mut observer, mut predictor) = (Observer::new(), Predictor::new());
        observer.observe(&scene, &self.camera, &self.viewpoint, self.time_s)?;
        let brake_s = self.speed_mps / self.limits.acceleration_mps2;
        let mut predict = |displacement: &Vec2| -> Result<f64, SenseError> {
            let position = self.rest + *displacement;
            if !self.ground.mesh.segment_inside(self.rest, position) {
                return Ok(UNREACHABLE);
            }
            let viewpoint = Viewpoint { position, ..self.viewpoint };
            let horizon_s = brake_s + rest_to_rest_s(displacement.length(), &self.limits);
            let hidden = observer.hidden();
            let shares = predictor.predict(&scene, &self.camera, hidden, &[viewpoint], self.time_s, horizon_s)?;
            Ok(shares.map_or(0.0, |shares| shares[0]))
        };
        displacements.iter().map(&mut predict).collect()
    }
}

/// Time of a straight move from rest to rest under the limits: a triangle or a trapezoid of speed.
fn rest_to_rest_s(distance_m: f64, limits: &Limits) -> f64 {
    let (speed, acceleration) = (limits.speed_mps, limits.acceleration_mps2);
    if distance_m <= speed * speed / acceleration {
        2.0 * (distance_m / acceleration).sqrt()
    } else {
        distance_m / speed + speed / acceleration
    }
}
