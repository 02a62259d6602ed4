//! One tile of the bake: triangles → free voxels → Recast's erosion, contours and convex polygons.
//!
//! Two steps differ from Recast's usual chain, because the domain is flat:
//! - the free voxels are filled in by their centres instead of "whatever a triangle touches", which halves the
//!   rounding;
//! - regions are cut by Recast's monotone partition (rows swept one after the other) instead of the watershed. Monotone
//!   regions have no holes and only straight seams, so the polygons cover the free voxels and nothing else; their long
//!   shapes, which mislead a search from centre to centre, do not matter to an any-angle search.

use rerecast::{AreaType, BuildContoursFlags, CompactHeightfield, Contour, ContourSet, RegionId, RegionVertexId};

use super::bake_config::BakeConfig;
use crate::geometry::Vec2;

/// Edge length of a tile in voxels: 128 m at 0.25 m.
pub(super) const TILE_VOXELS: usize = 512;
/// Polygons are merged up to this many corners.
const MOST_CORNERS: u16 = 8;
/// Recast's region numbers have 15 bits.
const MOST_REGIONS: usize = 0x7fff;

/// A corner of the voxel grid, east and north, counted from the domain's south-west corner.
pub(super) type GridPoint = (i32, i32);

/// A stretch of free voxels in one row: columns `from..to`.
#[derive(Debug, Clone, Copy)]
struct Run {
    row: usize,
    from: usize,
    to: usize,
    region: usize,
}

/// What is read around a tile so that its own voxels come out as in one large field.
pub(super) fn margin_voxels(config: &BakeConfig) -> u16 {
    config.radius_voxels() + 2
}

/// The convex polygons of one tile. Triangles are in voxels from the domain's south-west corner.
pub(super) fn bake<'a>(
    tile: (i32, i32),
    triangles: impl Iterator<Item = &'a [Vec2; 3]>,
    config: &BakeConfig,
) -> Result<Vec<Vec<GridPoint>>, String> {
    let margin = margin_voxels(config) as usize;
    let width = TILE_VOXELS + 2 * margin;
    let corner = (tile.0 * TILE_VOXELS as i32, tile.1 * TILE_VOXELS as i32);
    let south_west = Vec2::new(f64::from(corner.0), f64::from(corner.1)) - Vec2::new(margin as f64, margin as f64);
    let mut free = vec![false; width * width];
    for triangle in triangles {
        fill(&mut free, width, triangle.map(|point| point - south_west));
    }
    if !free.contains(&true) {
        return Ok(Vec::new());
    }
    let mut field = compact_field(&free, width, config.cell_size_m);
    field.erode_walkable_area(config.radius_voxels());
    field.border_size = margin as u16;
    let runs = partition(&mut field, margin);
    let regions = runs.iter().map(|run| run.region + 1).max().unwrap_or(0);
    if regions > MOST_REGIONS {
        return Err(format!("it falls into {regions} regions, and at most {MOST_REGIONS} can be numbered"));
    }
    let max_error = (config.max_edge_error_m / config.cell_size_m) as f32;
    let contours = field.build_contours(max_error, 0, BuildContoursFlags::empty());
    let mut polygons: Vec<Option<Vec<Vec<GridPoint>>>> = vec![None; regions];
    for contour in &contours.contours {
        polygons[contour.region.bits() as usize - 1] = convex_parts(&contours, contour);
    }
    // Recast gives no contour for a region of one voxel, and for a thin one straightening may cross its two sides.
    for (region, polygons) in polygons.iter_mut().enumerate().filter(|(_, polygons)| polygons.is_none()) {
        let rows = runs.iter().filter(|run| run.region == region);
        *polygons = Some(rows.map(|run| rectangle(run, margin)).collect());
    }
    let polygons = polygons.into_iter().flatten().flatten();
    Ok(polygons.map(|polygon| polygon.iter().map(|p| (p.0 + corner.0, p.1 + corner.1)).collect()).collect())
}

/// Marks the voxels whose centre lies in the triangle, its edges included.
fn fill(free: &mut [bool], width: usize, triangle: [Vec2; 3]) {
    // Two triangles with a common edge must leave no crack along it.
    const CRACK: f64 = 1.0e-6;
    let first_centre = |low: f64| (low - CRACK - 0.5).ceil().max(0.0) as usize;
    let end_centre = |high: f64| ((high + CRACK - 0.5).floor() + 1.0).clamp(0.0, width as f64) as usize;
    let low = triangle[0].y.min(triangle[1].y).min(triangle[2].y);
    let high = triangle[0].y.max(triangle[1].y).max(triangle[2].y);
    for row in first_centre(low)..end_centre(high) {
        let y = (row as f64 + 0.5).clamp(low, high);
        let (mut west, mut east) = (f64::MAX, f64::MIN);
        for i in 0..3 {
            let (a, b) = (triangle[i], triangle[(i + 1) % 3]);
            if (a.y.min(b.y)..=a.y.max(b.y)).contains(&y) {
                let x = if a.y == b.y { a.x } else { a.x + (y - a.y) / (b.y - a.y) * (b.x - a.x) };
                (west, east) = (west.min(x), east.max(x));
            }
        }
        for column in first_centre(west)..end_centre(east) {
            free[row * width + column] = true;
        }
    }
}

/// Recast's compact field with one span in every free voxel.
fn compact_field(free: &[bool], width: usize, cell_size_m: f64) -> CompactHeightfield {
    let mut field = CompactHeightfield {
        width: width as u16,
        height: width as u16,
        cell_size: cell_size_m as f32,
        cell_height: cell_size_m as f32,
        cells: vec![Default::default(); width * width],
        ..Default::default()
    };
    let is_free = |column: usize, row: usize| column < width && row < width && free[row * width + column];
    for row in 0..width {
        for column in (0..width).filter(|column| is_free(*column, row)) {
            let cell = &mut field.cells[row * width + column];
            cell.set_index(field.spans.len() as u32);
            cell.set_count(1);
            let mut span = rerecast::CompactSpan::default();
            // Recast's directions: 0 west, 1 north, 2 east, 3 south. Stepping below zero wraps to "not free".
            let beside =
                [(column.wrapping_sub(1), row), (column, row + 1), (column + 1, row), (column, row.wrapping_sub(1))];
            for (direction, (column, row)) in beside.into_iter().enumerate() {
                span.set_con(direction as u8, is_free(column, row).then_some(0));
            }
            field.spans.push(span);
            field.areas.push(AreaType::DEFAULT_WALKABLE);
        }
    }
    field
}

/// Recast's monotone partition of the free voxels inside the margin; those in the margin become border regions.
///
/// A row's run continues the region of the run below when each of the two touches only the other.
fn partition(field: &mut CompactHeightfield, margin: usize) -> Vec<Run> {
    let width = field.width as usize;
    let inner = margin..width - margin;
    let (mut runs, mut below): (Vec<Run>, Vec<Run>) = (Vec::new(), Vec::new());
    let mut regions = 0;
    for row in 0..width {
        let mut here = Vec::new();
        for column in 0..width {
            let cell = field.cells[row * width + column];
            if cell.count() == 0 || !field.areas[cell.index() as usize].is_walkable() {
                continue;
            }
            if !(inner.contains(&row) && inner.contains(&column)) {
                let side = [row < margin, row >= width - margin, column < margin].iter().position(|side| *side);
                let number = side.unwrap_or(3) as u16 + 1;
                field.spans[cell.index() as usize].region = RegionId::BORDER_REGION | RegionId::from(number);
                continue;
            }
            match here.last_mut() {
                Some(Run { to, .. }) if *to == column => *to += 1,
                _ => here.push(Run { row, from: column, to: column + 1, region: usize::MAX }),
            }
        }
        for i in 0..here.len() {
            let touching = |run: &Run, others: &[Run]| -> (usize, usize) {
                let first = others.partition_point(|other| other.to <= run.from);
                (first, others.partition_point(|other| other.from < run.to))
            };
            let (first, end) = touching(&here[i], &below);
            let continues = end - first == 1 && {
                let (first, end) = touching(&below[first], &here);
                end - first == 1
            };
            here[i].region = if continues { below[first].region } else { regions };
            regions = regions.max(here[i].region + 1);
            let region = RegionId::from(((here[i].region + 1) & MOST_REGIONS) as u16);
            for column in here[i].from..here[i].to {
                let span = field.cells[row * width + column].index() as usize;
                field.spans[span].region = region;
            }
        }
        runs.extend_from_slice(&here);
        below = here;
    }
    field.max_region = RegionId::from(regions.min(MOST_REGIONS) as u16);
    runs
}

/// One contour, triangulated and merged by Recast; `None` when the parts do not exactly make up the contour.
fn convex_parts(set: &ContourSet, contour: &Contour) -> Option<Vec<Vec<GridPoint>>> {
    let mut contour = contour.clone();
    // Recast removes corners on the seam of two tiles; here they are matched instead.
    contour.vertices.iter_mut().for_each(|(_, flags)| *flags &= !RegionVertexId::BORDER_VERTEX.bits());
    let outline: Vec<GridPoint> = contour.vertices.iter().map(|(p, _)| (p.x.into(), p.z.into())).collect();
    let single = ContourSet { contours: vec![contour], ..set_without_contours(set) };
    let mesh = single.into_polygon_mesh(MOST_CORNERS).ok()?;
    let place = |i: u16| (i32::from(mesh.vertices[i as usize].x), i32::from(mesh.vertices[i as usize].z));
    let whole = double_area(&outline);
    let parts: Vec<Vec<GridPoint>> = mesh
        .polygons()
        .map(|polygon| polygon.map(place).collect::<Vec<_>>())
        .filter(|polygon| double_area(polygon) != 0)
        .collect();
    let covered: i64 = parts.iter().map(|part| double_area(part)).sum();
    let is_partition = whole != 0
        && covered == whole
        && !crosses_itself(&outline)
        && parts.iter().all(|part| double_area(part).signum() == whole.signum() && is_convex(part, whole.signum()));
    is_partition.then_some(parts)
}

fn set_without_contours(set: &ContourSet) -> ContourSet {
    ContourSet { contours: Vec::new(), ..*set }
}

/// Twice the signed area, exactly.
fn double_area(polygon: &[GridPoint]) -> i64 {
    (0..polygon.len())
        .map(|i| {
            let (a, b) = (polygon[i], polygon[(i + 1) % polygon.len()]);
            i64::from(a.0) * i64::from(b.1) - i64::from(b.0) * i64::from(a.1)
        })
        .sum()
}

fn turn(a: GridPoint, b: GridPoint, c: GridPoint) -> i64 {
    i64::from(b.0 - a.0) * i64::from(c.1 - a.1) - i64::from(b.1 - a.1) * i64::from(c.0 - a.0)
}

fn is_convex(polygon: &[GridPoint], sign: i64) -> bool {
    let count = polygon.len();
    (0..count).all(|i| {
        let (a, b) = (polygon[i], polygon[(i + 1) % count]);
        polygon.iter().all(|c| turn(a, b, *c) * sign >= 0)
    })
}

/// Whether two edges of a closed line cross properly.
fn crosses_itself(outline: &[GridPoint]) -> bool {
    let count = outline.len();
    let edge = |i: usize| (outline[i], outline[(i + 1) % count]);
    (0..count).any(|i| {
        let (a, b) = edge(i);
        (i + 1..count).any(|j| {
            let (c, d) = edge(j);
            turn(a, b, c).signum() * turn(a, b, d).signum() < 0 && turn(c, d, a).signum() * turn(c, d, b).signum() < 0
        })
    })
}

fn rectangle(run: &Run, margin: usize) -> Vec<GridPoint> {
    let [west, east, south, north] = [run.from, run.to, run.row, run.row + 1].map(|i| (i - margin) as i32);
    vec![(west, south), (east, south), (east, north), (west, north)]
}
