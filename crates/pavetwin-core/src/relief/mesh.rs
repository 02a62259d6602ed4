//! A triangle mesh of a relief within an outline, dense where the surface bends.

use super::Grid;
use spade::{ConstrainedDelaunayTriangulation, HasPosition, Point2, Triangulation};

/// Vertices (x, y, z) [m] and triangles, anticlockwise from above. The first vertices are the outline's.
#[derive(Debug, Clone)]
pub struct Mesh {
    pub vertices: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
    /// Largest vertical distance between the mesh and a cell's centre [m].
    pub error_m: f64,
}

#[derive(Clone, Copy)]
struct Vertex {
    place: Point2<f64>,
    height: f64,
}

impl HasPosition for Vertex {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.place
    }
}

type Net = ConstrainedDelaunayTriangulation<Vertex>;

/// The mesh of `height_m` within `ring` (closed by itself, in metres), whose vertices lie at height 0.
///
/// Points of the grid are added where the surface is farthest from its triangle until it is nowhere more than
/// `tolerance_m` away, or `most` vertices are there (Garland and Heckbert, "Fast polygonal approximation of terrains
/// and height fields", 1995, one point a triangle and round). None when the ring cannot be triangulated.
pub fn mesh(grid: &Grid, height_m: &[f32], ring: &[[f64; 2]], tolerance_m: f64, most: usize) -> Option<Mesh> {
    let corners: Vec<Vertex> =
        ring.iter().map(|corner| Vertex { place: Point2::new(corner[0], corner[1]), height: 0.0 }).collect();
    let edges = (0..ring.len()).map(|index| [index, (index + 1) % ring.len()]).collect();
    let mut net = Net::bulk_load_cdt(corners, edges).ok()?;
    let border = Border::new(ring, grid.cell_m);
    loop {
        let (wanted, error) = worst(&net, grid, height_m, &border, tolerance_m);
        let room = most.saturating_sub(net.num_vertices());
        if wanted.is_empty() || room == 0 {
            return Some(finish(&net, error));
        }
        let mut order: Vec<(f64, usize)> = wanted;
        if order.len() > room {
            order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            order.truncate(room);
        }
        let before = net.num_vertices();
        for (_, at) in order {
            let place = centre(grid, at);
            net.insert(Vertex { place, height: f64::from(height_m[at]) }).ok()?;
        }
        if net.num_vertices() == before {
            return Some(finish(&net, error));
        }
    }
}

fn centre(grid: &Grid, at: usize) -> Point2<f64> {
    let (row, col) = (at / grid.cols, at % grid.cols);
    Point2::new(grid.x0_m + col as f64 * grid.cell_m, grid.y0_m + row as f64 * grid.cell_m)
}

/// The worst cell of every triangle that is beyond the tolerance, and the largest error of all.
fn worst(net: &Net, grid: &Grid, height_m: &[f32], border: &Border, tolerance_m: f64) -> (Vec<(f64, usize)>, f64) {
    let (mut wanted, mut largest) = (Vec::new(), 0.0f64);
    let inside = faces_inside(net);
    for face in net.inner_faces().filter(|face| inside[face.index()]) {
        let corners = face.vertices().map(|vertex| *vertex.data());
        let [a, b, c] = corners;
        let (abx, aby) = (b.place.x - a.place.x, b.place.y - a.place.y);
        let (acx, acy) = (c.place.x - a.place.x, c.place.y - a.place.y);
        let twice = abx * acy - aby * acx;
        if twice.abs() < 1e-14 {
            continue;
        }
        let low = a.place.y.min(b.place.y).min(c.place.y);
        let high = a.place.y.max(b.place.y).max(c.place.y);
        let (first, end) = grid.rows_between(low, high);
        let mut worst = (tolerance_m, usize::MAX);
        for row in first..end {
            let y = grid.y0_m + row as f64 * grid.cell_m;
            let Some((left, right)) = crossing(&corners, y) else { continue };
            let (from, to) = grid.columns(left, right);
            for col in from..to {
                let (px, py) = (grid.x0_m + col as f64 * grid.cell_m - a.place.x, y - a.place.y);
                let (s, t) = ((px * acy - py * acx) / twice, (abx * py - aby * px) / twice);
                let flat = a.height + s * (b.height - a.height) + t * (c.height - a.height);
                let at = row * grid.cols + col;
                let error = (f64::from(height_m[at]) - flat).abs();
                if error <= largest.min(worst.0) || border.is_near(px + a.place.x, y) {
                    continue;
                }
                largest = largest.max(error);
                if error > worst.0 {
                    worst = (error, at);
                }
            }
        }
        if worst.1 != usize::MAX {
            wanted.push(worst);
        }
    }
    (wanted, largest)
}

/// Where a horizontal line crosses a triangle.
fn crossing(corners: &[Vertex; 3], y: f64) -> Option<(f64, f64)> {
    let (mut left, mut right) = (f64::MAX, f64::MIN);
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        let (p, q) = (corners[a].place, corners[b].place);
        if (p.y <= y) != (q.y <= y) {
            let x = p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x);
            (left, right) = (left.min(x), right.max(x));
        }
    }
    (left <= right).then_some((left, right))
}

fn finish(net: &Net, error_m: f64) -> Mesh {
    let inside = faces_inside(net);
    let vertices = net
        .vertices()
        .map(|vertex| {
            let Vertex { place, height } = *vertex.data();
            [place.x as f32, place.y as f32, height as f32]
        })
        .collect();
    let triangles = net
        .inner_faces()
        .filter(|face| inside[face.index()])
        .map(|face| face.vertices().map(|vertex| vertex.fix().index() as u32))
        .collect();
    Mesh { vertices, triangles, error_m }
}

/// Whether each face, by its index, lies inside the ring: as many of the ring's edges as there are between it and the
/// outer face, an odd number. Counting edges is exact where asking for a sliver's middle is not.
fn faces_inside(net: &Net) -> Vec<bool> {
    let mut inside = vec![false; net.num_all_faces()];
    let mut known = inside.clone();
    let mut stack = vec![];
    for edge in net.convex_hull() {
        for side in [edge, edge.rev()] {
            if let Some(face) = side.face().as_inner()
                && !known[face.index()]
            {
                known[face.index()] = true;
                inside[face.index()] = edge.is_constraint_edge();
                stack.push(face);
            }
        }
    }
    while let Some(face) = stack.pop() {
        for edge in face.adjacent_edges() {
            if let Some(next) = edge.rev().face().as_inner()
                && !known[next.index()]
            {
                known[next.index()] = true;
                inside[next.index()] = inside[face.index()] != edge.is_constraint_edge();
                stack.push(next);
            }
        }
    }
    inside
}

/// A ring's edges in bands of y, to tell quickly what lies near it.
struct Border {
    low: f64,
    band: f64,
    bands: Vec<Vec<[[f64; 2]; 2]>>,
    margin: f64,
}

impl Border {
    fn new(ring: &[[f64; 2]], cell_m: f64) -> Self {
        let low = ring.iter().map(|corner| corner[1]).fold(f64::MAX, f64::min);
        let high = ring.iter().map(|corner| corner[1]).fold(f64::MIN, f64::max);
        let band = 2.0 * cell_m;
        let margin = 0.5 * cell_m;
        let count = ((high - low) / band).floor() as usize + 1;
        let mut bands = vec![Vec::new(); count];
        for (index, &a) in ring.iter().enumerate() {
            let b = ring[(index + 1) % ring.len()];
            let slot = |y: f64| (((y - low) / band).max(0.0) as usize).min(count - 1);
            for each in &mut bands[slot(a[1].min(b[1]) - margin)..=slot(a[1].max(b[1]) + margin)] {
                each.push([a, b]);
            }
        }
        Self { low, band, bands, margin }
    }

    fn edges(&self, y: f64) -> &[[[f64; 2]; 2]] {
        let slot = (y - self.low) / self.band;
        if slot < 0.0 { &[] } else { self.bands.get(slot as usize).map_or(&[], Vec::as_slice) }
    }

    /// Whether a point is so near the ring that a vertex there would make slivers of the triangles beside it.
    fn is_near(&self, x: f64, y: f64) -> bool {
        self.edges(y).iter().any(|[a, b]| {
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            let along = (((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
            (x - a[0] - along * dx).hypot(y - a[1] - along * dy) < self.margin
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bowl_is_meshed_within_the_tolerance() {
        let grid = Grid { rows: 81, cols: 81, cell_m: 0.01, x0_m: -0.4, y0_m: -0.4 };
        let height = |x: f64, y: f64| -0.05 * (1.0 - (x.hypot(y) / 0.3).powi(2)).max(0.0);
        let field: Vec<f32> =
            (0..grid.len()).map(|at| centre(&grid, at)).map(|place| height(place.x, place.y) as f32).collect();
        let ring: Vec<[f64; 2]> = (0..40)
            .map(|step| f64::from(step) * std::f64::consts::TAU / 40.0)
            .map(|a| [0.35 * a.cos(), 0.35 * a.sin()])
            .collect();
        let made = mesh(&grid, &field, &ring, 0.001, 5000).unwrap();
        assert!(made.error_m <= 0.001, "{}", made.error_m);
        assert!(made.vertices[..40].iter().all(|vertex| vertex[2] == 0.0));
        let area: f32 = made
            .triangles
            .iter()
            .map(|t| t.map(|index| made.vertices[index as usize]))
            .map(|[a, b, c]| 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])))
            .sum();
        assert!((area - 0.35 * 0.35 * 20.0 * (std::f32::consts::TAU / 40.0).sin()).abs() < 1e-5, "{area}");
        let few = mesh(&grid, &field, &ring, 0.0001, 100).unwrap();
        assert!(few.vertices.len() <= 100 && few.error_m > 0.0001);
    }
}
