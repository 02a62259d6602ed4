//! What stands still during missions at one altitude: the mesh, the solids, the surfaces to inspect, the defects.

use crate::geometry::Vec2;
use crate::navigation::NavMesh;
use crate::sensing::{Solids, SurfaceGrid};

/// A segment's surface cells and the defects that lie on it.
#[derive(Debug, Clone)]
pub struct SegmentSurface {
    pub grid: SurfaceGrid,
    /// Indices into [`Ground::defects`].
    pub defects: Vec<u32>,
}

/// A defect as the camera meets it.
#[derive(Debug, Clone)]
pub struct DefectTarget {
    pub centre: Vec2,
    /// Points spread over its area.
    pub points: Vec<Vec2>,
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
    NoPoints { defect: usize },
}

impl Ground {
    /// Joins the parts; `segment_of` names each defect's segment.
    ///
    /// # Errors
    /// When a defect names a segment that is not there or has no points.
    pub fn new(
        mesh: NavMesh,
        solids: Solids,
        grids: Vec<SurfaceGrid>,
        defects: Vec<DefectTarget>,
        segment_of: &[u32],
    ) -> Result<Self, GroundError> {
        let mut segments: Vec<_> = grids.into_iter().map(|grid| SegmentSurface { grid, defects: Vec::new() }).collect();
        let count = segments.len();
        for (defect, (target, &segment)) in defects.iter().zip(segment_of).enumerate() {
            if target.points.is_empty() {
                return Err(GroundError::NoPoints { defect });
            }
            let surface = segments.get_mut(segment as usize);
            let surface = surface.ok_or(GroundError::UnknownSegment { defect, segment, segments: count })?;
            surface.defects.push(defect as u32);
        }
        Ok(Self { mesh, solids, segments, defects })
    }
}
