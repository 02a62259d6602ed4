//! The pattern of blocks: cells of sites under a Minkowski metric, and how far it is to the joint between two of them.

use super::Grid;

/// Which block each grid cell lies in, and the joint nearest to it.
#[derive(Debug, Clone)]
pub struct Blocks {
    /// Index of the nearest site.
    pub own: Vec<u16>,
    /// Index of the second nearest; the own one where no joint is within reach.
    pub other: Vec<u16>,
    /// To the joint between the two, to first order: within a twentieth of it. At most the reach [m].
    pub distance_m: Vec<f32>,
}

const TILE: usize = 4;
/// Candidates are chosen for squares of this many tiles first.
const COARSE: usize = 6 * TILE;

/// Blocks of `sites` under the Minkowski metric of exponent `half_exponent / 2`, seen through a warp of the plane.
///
/// `warp_x` and `warp_y` [m] are added to every cell's position before it is compared with the sites; exponents are
/// halves of whole numbers because such powers need nothing but products and square roots. Squares of four cells of
/// which none is `wanted` are left as if one block covered them.
pub fn blocks(
    grid: &Grid,
    wanted: &[bool],
    sites: &[[f64; 2]],
    half_exponent: u32,
    warp_x: &[f32],
    warp_y: &[f32],
    reach_m: f64,
) -> Blocks {
    let pattern = Pattern { grid, wanted, sites, half_exponent, warp_x, warp_y, reach_m };
    // A known exponent leaves products and roots alone in the loops.
    match half_exponent {
        3 => pattern.found(|value| power(value, 3), |value| power(value, 1)),
        4 => pattern.found(|value| power(value, 4), |value| power(value, 2)),
        5 => pattern.found(|value| power(value, 5), |value| power(value, 3)),
        6 => pattern.found(|value| power(value, 6), |value| power(value, 4)),
        other => pattern.found(|value| power(value, other), |value| power(value, other - 2)),
    }
}

/// A non-negative number to the power of `halves / 2`.
#[inline(always)]
fn power(value: f32, halves: u32) -> f32 {
    let rest = if halves % 2 == 1 { value.sqrt() } else { 1.0 };
    (0..halves / 2).fold(rest, |product, _| product * value)
}

struct Pattern<'a> {
    grid: &'a Grid,
    wanted: &'a [bool],
    sites: &'a [[f64; 2]],
    half_exponent: u32,
    warp_x: &'a [f32],
    warp_y: &'a [f32],
    reach_m: f64,
}

/// A site relative to a tile's middle [m], with its index.
type Site = (u16, [f32; 2]);

impl Pattern<'_> {
    fn found(&self, raise: impl Fn(f32) -> f32, slope: impl Fn(f32) -> f32) -> Blocks {
        let (grid, size) = (self.grid, self.grid.len());
        let mut found =
            Blocks { own: vec![0; size], other: vec![0; size], distance_m: vec![self.reach_m as f32; size] };
        let all: Vec<usize> = (0..self.sites.len()).collect();
        let (mut around, mut near, mut raised) = (Vec::new(), Vec::new(), Vec::new());
        for top in (0..grid.rows).step_by(COARSE) {
            for left in (0..grid.cols).step_by(COARSE) {
                let square = self.tile(top, left, COARSE);
                self.candidates(&square, &all, &raise, (&mut raised, &mut around));
                for row in (top..(top + COARSE).min(grid.rows)).step_by(TILE) {
                    for col in (left..(left + COARSE).min(grid.cols)).step_by(TILE) {
                        if any(grid, self.wanted, row, col) {
                            let tile = self.tile(row, col, TILE);
                            let farthest = self.candidates(&tile, &around, &raise, (&mut raised, &mut near));
                            self.fill(&tile, &near, farthest, (&raise, &slope), &mut found);
                        }
                    }
                }
            }
        }
        found
    }

    fn exponent(&self) -> f32 {
        0.5 * self.half_exponent as f32
    }

    /// Most that a norm grows by over a metre.
    fn steepest(&self) -> f32 {
        2f32.powf((1.0 / self.exponent() - 0.5).max(0.0))
    }

    fn tile(&self, row: usize, col: usize, size: usize) -> Tile {
        let (grid, mut low, mut high) = (self.grid, [f64::MAX; 2], [f64::MIN; 2]);
        let rows = (row, (row + size).min(grid.rows));
        let cols = (col, (col + size).min(grid.cols));
        for row in rows.0..rows.1 {
            for col in cols.0..cols.1 {
                let place = self.place(row, col);
                low = [low[0].min(place[0]), low[1].min(place[1])];
                high = [high[0].max(place[0]), high[1].max(place[1])];
            }
        }
        let centre = [(low[0] + high[0]) / 2.0, (low[1] + high[1]) / 2.0];
        Tile { rows, cols, centre, half: [(high[0] - centre[0]) as f32, (high[1] - centre[1]) as f32] }
    }

    /// The sites that are nearest or within reach of being so somewhere in the tile, in their order; the farthest that
    /// one of them is.
    fn candidates(
        &self,
        tile: &Tile,
        sites: &[usize],
        raise: &impl Fn(f32) -> f32,
        (raised, near): (&mut Vec<f32>, &mut Vec<usize>),
    ) -> f32 {
        // Powers of distances order as distances do; only the least and the limit need their roots.
        raised.clear();
        raised.extend(sites.iter().map(|&site| {
            let [x, y] = tile.seen(self.sites[site]);
            raise(x.abs()) + raise(y.abs())
        }));
        let root = 1.0 / self.exponent();
        let half = (raise(tile.half[0]) + raise(tile.half[1])).powf(root);
        let least = raised.iter().copied().fold(f32::MAX, f32::min).powf(root);
        let limit = least + 2.0 * half + 2.0 * self.steepest() * self.reach_m as f32;
        // A little more than needed, for what single precision loses.
        let most = 1.001 * raise(limit);
        near.clear();
        near.extend(sites.iter().zip(&*raised).filter(|&(_, &away)| away <= most).map(|(&site, _)| site));
        limit + half
    }

    fn fill(
        &self,
        tile: &Tile,
        near: &[usize],
        farthest: f32,
        (raise, slope): (&impl Fn(f32) -> f32, &impl Fn(f32) -> f32),
        found: &mut Blocks,
    ) {
        let (mut x, mut y) = ([0.0f32; TILE * TILE], [0.0f32; TILE * TILE]);
        let cols = tile.cols.1 - tile.cols.0;
        for row in tile.rows.0..tile.rows.1 {
            for col in tile.cols.0..tile.cols.1 {
                let at = (row - tile.rows.0) * TILE + col - tile.cols.0;
                [x[at], y[at]] = tile.seen(self.place(row, col));
            }
        }
        let sites: Vec<Site> = near.iter().map(|&site| (site as u16, tile.seen(self.sites[site]))).collect();
        let ranked = Ranked::of(&x, &y, &sites, raise);
        // Beyond this difference of powers a joint is out of reach, however steep they are in the tile.
        let reach = self.reach_m as f32;
        let apart = 2.0 * self.steepest() * reach * self.exponent() * farthest.powf(self.exponent() - 1.0);
        for row in tile.rows.0..tile.rows.1 {
            for step in 0..cols {
                let at = (row - tile.rows.0) * TILE + step;
                let ((own, a), (other, b)) = (sites[ranked.first[at]], sites[ranked.second[at]]);
                let cell = row * self.grid.cols + tile.cols.0 + step;
                (found.own[cell], found.other[cell]) = (own, own);
                let ahead = ranked.next[at] - ranked.least[at];
                if sites.len() == 1 || ahead > apart {
                    continue;
                }
                // How far it is to where both powers are equal: their difference over its slope.
                let leaning = |along: f32| self.exponent() * slope(along.abs()).copysign(along);
                let rise_x = leaning(x[at] - b[0]) - leaning(x[at] - a[0]);
                let rise_y = leaning(y[at] - b[1]) - leaning(y[at] - a[1]);
                let distance = ahead / (rise_x * rise_x + rise_y * rise_y).sqrt().max(f32::MIN_POSITIVE);
                if distance < reach {
                    (found.other[cell], found.distance_m[cell]) = (other, distance);
                }
            }
        }
    }

    fn place(&self, row: usize, col: usize) -> [f64; 2] {
        let (grid, at) = (self.grid, row * self.grid.cols + col);
        let x = grid.x0_m + col as f64 * grid.cell_m + f64::from(self.warp_x[at]);
        let y = grid.y0_m + row as f64 * grid.cell_m + f64::from(self.warp_y[at]);
        [x, y]
    }
}

struct Tile {
    rows: (usize, usize),
    cols: (usize, usize),
    centre: [f64; 2],
    half: [f32; 2],
}

impl Tile {
    /// A place relative to the tile's middle.
    fn seen(&self, place: [f64; 2]) -> [f32; 2] {
        [(place[0] - self.centre[0]) as f32, (place[1] - self.centre[1]) as f32]
    }
}

/// The nearest site of each cell and the next one, with their powers of distance.
struct Ranked {
    least: [f32; TILE * TILE],
    next: [f32; TILE * TILE],
    first: [usize; TILE * TILE],
    second: [usize; TILE * TILE],
}

impl Ranked {
    /// One site after the other over all cells: the same arithmetic side by side, which the compiler widens.
    fn of(x: &[f32; TILE * TILE], y: &[f32; TILE * TILE], sites: &[Site], raise: &impl Fn(f32) -> f32) -> Self {
        let mut least = [f32::MAX; TILE * TILE];
        let mut next = [f32::MAX; TILE * TILE];
        let (mut first, mut second) = ([0u32; TILE * TILE], [0u32; TILE * TILE]);
        for (slot, (_, site)) in (0u32..).zip(sites) {
            for at in 0..TILE * TILE {
                let raised = raise((x[at] - site[0]).abs()) + raise((y[at] - site[1]).abs());
                let (leads, follows) = (raised < least[at], raised < next[at]);
                second[at] = if leads {
                    first[at]
                } else if follows {
                    slot
                } else {
                    second[at]
                };
                next[at] = if leads {
                    least[at]
                } else if follows {
                    raised
                } else {
                    next[at]
                };
                first[at] = if leads { slot } else { first[at] };
                least[at] = if leads { raised } else { least[at] };
            }
        }
        Self { least, next, first: first.map(|slot| slot as usize), second: second.map(|slot| slot as usize) }
    }
}

fn any(grid: &Grid, wanted: &[bool], row: usize, col: usize) -> bool {
    let end = (col + TILE).min(grid.cols);
    (row..(row + TILE).min(grid.rows)).any(|row| wanted[row * grid.cols + col..row * grid.cols + end].contains(&true))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_joint_of_two_sites_lies_half_way() {
        let grid = Grid { rows: 40, cols: 60, cell_m: 0.01, x0_m: 0.0, y0_m: 0.0 };
        let still = vec![0.0f32; grid.len()];
        for half_exponent in [3, 4, 5, 6] {
            let found =
                blocks(&grid, &vec![true; grid.len()], &[[0.1, 0.2], [0.5, 0.2]], half_exponent, &still, &still, 0.05);
            for col in 0..60 {
                let x = col as f32 * 0.01;
                let at = 20 * 60 + col;
                assert_eq!(found.own[at], u16::from(x > 0.3001), "{x}");
                let away = (x - 0.3).abs().min(0.05);
                assert!((found.distance_m[at] - away).abs() < 1e-5 + 0.05 * away, "{x}");
            }
        }
    }
}
