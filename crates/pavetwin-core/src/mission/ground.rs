//! What stands still during missions at one altitude: the mesh, the solids, the surfaces to inspect, the defects.

use crate::geometry::Vec2;
use crate::navigation::NavMesh;
use crate::sensing::{Solids, SurfaceGrid};
use std::sync::OnceLock;

/// A segment's surface cells and the defects that lie on it.
#[derive(Debug, Clone)]
pub struct SegmentSurface {
    pub grid: SurfaceGrid,
    /// Indices into [`Ground::defects`].
    pub defects: Vec<u32>,
}

/// A defect as the camera meets it. A town has thousands, of which a mission meets a few: each is sampled when its
/// segment is first inspected.
#[derive(Debug, Clone)]
pub struct DefectTarget {
    pub centre: Vec2,
    points: OnceLock<Vec<Vec2>>,
}

impl DefectTarget {
    /// A defect that is not sampled yet.
    #[must_use]
    pub fn at(centre: Vec2) -> Self {
        Self { centre, points: OnceLock::new() }
    }

    /// Points spread over its area; `None` before it is sampled.
    #[must_use]
    pub fn points(&self) -> Option<&[Vec2]> {
        self.points.get().map(Vec::as_slice)
    }
}

/// Shared by every mission over the same world at the same altitude.
#[derive(Debug)]
pub struct Ground {
    pub mesh: NavMesh,
    pub solids: Solids,
    pub segments: Vec<SegmentSurface>,
    pub defects: Vec<DefectTarget>,
}

/// Why a ground cannot be made of its parts.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GroundError {
    #[error("defect {defect} lies on segment {segment}, but there are {segments} segments")]
    UnknownSegment { defect: usize, segment: u32, segments: usize },
    #[error("defect {defect} has no sample points")]
    NoPoints { defect: u32 },
}

impl Ground {
    /// Joins the parts; `segment_of` names each defect's segment.
    ///
    /// # Errors
    /// When a defect names a segment that is not there.
    pub fn new(
        mesh: NavMesh,
        solids: Solids,
        grids: Vec<SurfaceGrid>,
        defects: Vec<DefectTarget>,
        segment_of: &[u32],
    ) -> Result<Self, GroundError> {
        let mut segments: Vec<_> = grids.into_iter().map(|grid| SegmentSurface { grid, defects: Vec::new() }).collect();
        let count = segments.len();
        for (defect, &segment) in segment_of.iter().enumerate() {
            let surface = segments.get_mut(segment as usize);
            let surface = surface.ok_or(GroundError::UnknownSegment { defect, segment, segments: count })?;
            surface.defects.push(defect as u32);
        }
        Ok(Self { mesh, solids, segments, defects })
    }

    /// Gives the points of a defect, unless they are there already.
    ///
    /// # Errors
    /// What `sample` returns, or that it gave no points.
    pub fn sample<E: From<GroundError>>(
        &self,
        defect: u32,
        sample: impl FnOnce() -> Result<Vec<Vec2>, E>,
    ) -> Result<&[Vec2], E> {
        let target = &self.defects[defect as usize].points;
        if let Some(points) = target.get() {
            return Ok(points);
        }
        let points = sample()?;
        if points.is_empty() {
            return Err(GroundError::NoPoints { defect }.into());
        }
        Ok(target.get_or_init(|| points))
    }
}
