//! What stands still and may hide the ground: upright prisms over convex bases. Parked vehicles are kept apart from what
//! is built and grown.

use super::cells::{CellBlock, MAX_COORDINATE_M};
use crate::geometry::Vec2;

/// Least area of a base, m²: below it there is nothing to hide behind, only a triangulation's sliver.
pub const MIN_BASE_M2: f64 = 1.0e-9;

/// Largest extent of a base, metres; larger ones would fill the index.
const MAX_EXTENT_M: f64 = 10_000.0;

/// Why a solid cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SolidError {
    #[error("a solid's coordinates must be finite, within ±1000 km, and its base at most 10 km wide")]
    Coordinates,
    #[error("a solid's top ({top_m} m) must be above its underside ({base_m} m), and that not below the ground")]
    Heights { base_m: f64, top_m: f64 },
    #[error("a solid's base has no area: leave slivers out")]
    Degenerate,
    #[error("a solid's base is not convex: cut it into convex pieces first")]
    NotConvex,
}

/// An upright prism: a building's triangle, a trunk, a crown, a pole.
#[derive(Debug, Clone, PartialEq)]
pub struct Prism {
    base: Vec<Vec2>,
    base_m: f64,
    top_m: f64,
}

impl Prism {
    /// A prism over the convex polygon `base` (either direction) between the heights `base_m` and `top_m` above ground.
    ///
    /// # Errors
    /// When the base is not a convex polygon, or the heights are not in order.
    pub fn new(mut base: Vec<Vec2>, base_m: f64, top_m: f64) -> Result<Self, SolidError> {
        if !(base_m >= 0.0 && top_m > base_m && top_m.is_finite()) {
            return Err(SolidError::Heights { base_m, top_m });
        }
        let (min, max) = bounds(&base);
        let is_placed = |p: &Vec2| p.x.abs() <= MAX_COORDINATE_M && p.y.abs() <= MAX_COORDINATE_M;
        if !base.iter().all(is_placed) || max.x - min.x > MAX_EXTENT_M || max.y - min.y > MAX_EXTENT_M {
            return Err(SolidError::Coordinates);
        }
        base.dedup();
        if base.len() > 1 && base.first() == base.last() {
            base.pop();
        }
        let doubled_m2 = doubled_area_m2(&base);
        if base.len() < 3 || doubled_m2.abs() < 2.0 * MIN_BASE_M2 {
            return Err(SolidError::Degenerate);
        }
        if doubled_m2 < 0.0 {
            base.reverse();
        }
        if is_convex(&base, doubled_m2.abs()) { Ok(Self { base, base_m, top_m }) } else { Err(SolidError::NotConvex) }
    }

    /// The base's corners, counter-clockwise.
    pub fn base(&self) -> &[Vec2] {
        &self.base
    }

    /// Height of the underside above the ground, metres.
    pub fn base_m(&self) -> f64 {
        self.base_m
    }

    /// Height of the top above the ground, metres.
    pub fn top_m(&self) -> f64 {
        self.top_m
    }
}

fn bounds(points: &[Vec2]) -> (Vec2, Vec2) {
    let start = Vec2::new(f64::INFINITY, f64::INFINITY);
    points.iter().fold((start, -start), |(min, max), p| {
        (Vec2::new(min.x.min(p.x), min.y.min(p.y)), Vec2::new(max.x.max(p.x), max.y.max(p.y)))
    })
}

fn doubled_area_m2(ring: &[Vec2]) -> f64 {
    // About the first corner, so that a small base far from the origin keeps its digits.
    (2..ring.len()).map(|i| (ring[i - 1] - ring[0]).cross(ring[i] - ring[0])).sum()
}

/// No corner turns right by more than rounding, and the ring goes round once.
fn is_convex(ring: &[Vec2], doubled_m2: f64) -> bool {
    let edge = |i: usize| ring[(i + 1) % ring.len()] - ring[i % ring.len()];
    let tolerance_m2 = 1.0e-9 * doubled_m2;
    let turns_left = (0..ring.len()).all(|i| edge(i).cross(edge(i + 1)) >= -tolerance_m2);
    let turn_rad = |i: usize| edge(i).cross(edge(i + 1)).atan2(edge(i).dot(edge(i + 1)));
    let turned_rad: f64 = (0..ring.len()).map(turn_rad).sum();
    turns_left && (turned_rad - std::f64::consts::TAU).abs() < 1.0e-3
}

/// A solid as a query finds it.
#[derive(Debug, Clone, Copy)]
pub struct Solid<'a> {
    /// The base's corners, counter-clockwise.
    pub base: &'a [Vec2],
    /// Height of the underside above the ground, metres.
    pub base_m: f64,
    /// Height of the top above the ground, metres.
    pub top_m: f64,
    /// Centre and radius, in metres, of a circle that holds the base.
    pub centre: Vec2,
    pub radius_m: f64,
}

#[derive(Debug, Clone, Copy)]
struct Entry {
    first_corner: u32,
    corner_count: u32,
    base_m: f64,
    top_m: f64,
    /// Bounding box of the base.
    min: Vec2,
    max: Vec2,
}

impl Entry {
    fn meets(&self, min: Vec2, max: Vec2) -> bool {
        self.min.x <= max.x && self.max.x >= min.x && self.min.y <= max.y && self.max.y >= min.y
    }
}

/// Prisms, found by place.
#[derive(Debug, Clone, Default)]
struct PrismIndex {
    corners: Vec<Vec2>,
    entries: Vec<Entry>,
    /// Hash keys in ascending order, one for each cell that a base's bounding box meets.
    cell_keys: Vec<u32>,
    cell_entries: Vec<u32>,
}

impl PrismIndex {
    fn new(prisms: impl IntoIterator<Item = Prism>) -> Self {
        let mut found = Self::default();
        let mut index = Vec::new();
        for prism in prisms {
            let (min, max) = bounds(&prism.base);
            let block = CellBlock::covering(min, max);
            index.extend(block.keys().map(|key| (key, found.entries.len() as u32)));
            found.entries.push(Entry {
                first_corner: found.corners.len() as u32,
                corner_count: prism.base.len() as u32,
                base_m: prism.base_m,
                top_m: prism.top_m,
                min,
                max,
            });
            found.corners.extend(prism.base);
        }
        index.sort_unstable();
        (found.cell_keys, found.cell_entries) = index.into_iter().unzip();
        found
    }

    /// Calls `visit` once for every prism of whose base the bounding box meets the box from `min` to `max`.
    fn near(&self, min: Vec2, max: Vec2, mut visit: impl FnMut(Solid)) {
        if self.entries.is_empty() {
            return;
        }
        let block = CellBlock::covering(min, max);
        block.visit(&self.cell_keys, |position| {
            let entry = &self.entries[self.cell_entries[position] as usize];
            let filed = || CellBlock::covering(entry.min, entry.max);
            if entry.meets(min, max) && self.cell_keys[position] == filed().first_shared_key(&block) {
                visit(Solid {
                    base: &self.corners[entry.first_corner as usize..][..entry.corner_count as usize],
                    base_m: entry.base_m,
                    top_m: entry.top_m,
                    centre: (entry.min + entry.max) * 0.5,
                    radius_m: 0.5 * (entry.max - entry.min).dot(entry.max - entry.min).sqrt(),
                });
            }
        });
    }
}

/// Every static solid of a world, found by place: what is built and grown, and the parked vehicles.
#[derive(Debug, Clone, Default)]
pub struct Solids {
    fixed: PrismIndex,
    parked: PrismIndex,
}

impl Solids {
    /// Buildings, trees, street furniture; no vehicle is parked.
    pub fn new(prisms: impl IntoIterator<Item = Prism>) -> Self {
        Self { fixed: PrismIndex::new(prisms), parked: PrismIndex::default() }
    }

    /// The same with parked vehicles, in place of those before.
    #[must_use]
    pub fn with_parked(self, prisms: impl IntoIterator<Item = Prism>) -> Self {
        Self { parked: PrismIndex::new(prisms), ..self }
    }

    /// Calls `visit` once for every solid but the parked vehicles whose base's bounding box meets the box from `min` to
    /// `max`.
    pub fn near(&self, min: Vec2, max: Vec2, visit: impl FnMut(Solid)) {
        self.fixed.near(min, max, visit);
    }

    /// As [`Solids::near`], for the parked vehicles.
    pub fn parked_near(&self, min: Vec2, max: Vec2, visit: impl FnMut(Solid)) {
        self.parked.near(min, max, visit);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64, side: f64) -> Vec<Vec2> {
        vec![Vec2::new(x, y), Vec2::new(x + side, y), Vec2::new(x + side, y + side), Vec2::new(x, y + side)]
    }

    #[test]
    fn bases_are_convex_and_turn_left() {
        let mut clockwise = square(5.0, 5.0, 2.0);
        clockwise.reverse();
        let prism = Prism::new(clockwise, 0.0, 3.0).unwrap();
        assert!(doubled_area_m2(prism.base()) > 0.0);
        let mut closed = square(0.0, 0.0, 1.0);
        closed.push(closed[0]);
        assert_eq!(Prism::new(closed, 0.0, 1.0).unwrap().base().len(), 4);
    }

    #[test]
    fn what_is_no_solid_is_refused() {
        let arrow = [(0.0, 0.0), (4.0, 0.0), (1.0, 1.0), (0.0, 4.0)].map(|(x, y)| Vec2::new(x, y)).to_vec();
        assert_eq!(Prism::new(arrow, 0.0, 1.0), Err(SolidError::NotConvex));
        let star: Vec<Vec2> = (0..5).map(|i| Vec2::from_yaw(f64::from(i) * 0.8 * std::f64::consts::PI)).collect();
        assert_eq!(Prism::new(star, 0.0, 1.0), Err(SolidError::NotConvex));
        assert_eq!(Prism::new(square(0.0, 0.0, 0.0), 0.0, 1.0), Err(SolidError::Degenerate));
        assert_eq!(Prism::new(square(0.0, 0.0, 2e4), 0.0, 1.0), Err(SolidError::Coordinates));
        assert!(matches!(Prism::new(square(0.0, 0.0, 1.0), 2.0, 1.0), Err(SolidError::Heights { .. })));
        assert!(matches!(Prism::new(square(f64::NAN, 0.0, 1.0), 0.0, 1.0), Err(SolidError::Coordinates)));
    }

    #[test]
    fn a_large_base_is_found_once_from_anywhere() {
        let prisms = [square(-100.0, -100.0, 300.0), square(500.0, 0.0, 1.0)].map(|b| Prism::new(b, 0.0, 9.0).unwrap());
        let solids = Solids::new(prisms);
        for (x, y) in [(-90.0, -90.0), (0.0, 0.0), (190.0, 190.0)] {
            let mut found = 0;
            solids.near(Vec2::new(x, y), Vec2::new(x + 90.0, y + 90.0), |_| found += 1);
            assert_eq!(found, 1);
        }
    }

    #[test]
    fn parked_vehicles_are_found_apart() {
        let prism = |x: f64| Prism::new(square(x, 0.0, 1.0), 0.0, 1.5).unwrap();
        let solids = Solids::new([prism(0.0)]).with_parked([prism(3.0), prism(6.0)]);
        let (mut fixed, mut parked) = (Vec::new(), Vec::new());
        solids.near(Vec2::ZERO, Vec2::new(9.0, 9.0), |solid| fixed.push(solid.centre.x));
        solids.parked_near(Vec2::ZERO, Vec2::new(9.0, 9.0), |solid| parked.push(solid.centre.x));
        parked.sort_by(f64::total_cmp);
        assert_eq!((fixed, parked), (vec![0.5], vec![3.5, 6.5]));
    }
}
