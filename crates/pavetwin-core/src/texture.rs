//! Textures as a graphics card samples them: halved levels, wrapped or clamped, filtered trilinearly.

/// One level: `side` × `side` texels of so many channels as all levels have, row 0 at v = 0.
#[derive(Clone, Copy, Debug)]
pub struct Level<'a> {
    pub side: usize,
    pub texels: &'a [f32],
}

/// A texture's levels, each half as wide as the one before.
#[derive(Clone, Debug)]
pub struct Texture<'a> {
    pub levels: Vec<Level<'a>>,
    pub channels: usize,
    /// Whether it repeats; else its edge texels go on outwards.
    pub wraps: bool,
}

impl Texture<'_> {
    /// Values at texture coordinates, texel centres at (i + ½) / side; levels between two are mixed.
    pub fn sample(&self, uv: &[[f64; 2]], level: &[f32]) -> Vec<f32> {
        let mut found = vec![0.0; uv.len() * self.channels];
        let last = self.levels.len() - 1;
        for ((at, level), out) in uv.iter().zip(level).zip(found.chunks_exact_mut(self.channels)) {
            let level = level.clamp(0.0, last as f32);
            let (lower, share) = (level as usize, level.fract());
            self.add(self.levels[lower], *at, 1.0 - share, out);
            if share > 0.0 {
                self.add(self.levels[lower + 1], *at, share, out);
            }
        }
        found
    }

    fn add(&self, level: Level<'_>, [u, v]: [f64; 2], weight: f32, out: &mut [f32]) {
        let ((left, right, x), (low, high, y)) = (self.between(u, level.side), self.between(v, level.side));
        let texel = |row: usize, column: usize| &level.texels[(row * level.side + column) * self.channels..];
        let (a, b, c, d) = (texel(low, left), texel(low, right), texel(high, left), texel(high, right));
        for (out, (((a, b), c), d)) in out.iter_mut().zip(a.iter().zip(b).zip(c).zip(d)) {
            let (lower, upper) = (a * (1.0 - x) + b * x, c * (1.0 - x) + d * x);
            *out += weight * (lower * (1.0 - y) + upper * y);
        }
    }

    /// The texels on both sides of a coordinate, and how far it lies from the first to the second.
    fn between(&self, coordinate: f64, side: usize) -> (usize, usize, f32) {
        let at = coordinate * side as f64 - 0.5;
        let first = at.floor();
        let bounded = |texel: i64| {
            if self.wraps { texel.rem_euclid(side as i64) as usize } else { texel.clamp(0, side as i64 - 1) as usize }
        };
        (bounded(first as i64), bounded(first as i64 + 1), (at - first) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::{Level, Texture};

    /// 2 × 2 texels of one channel and their mean.
    fn four<'a>(wraps: bool, texels: &'a [f32; 4], mean: &'a [f32; 1]) -> Texture<'a> {
        let levels = vec![Level { side: 2, texels }, Level { side: 1, texels: mean }];
        Texture { levels, channels: 1, wraps }
    }

    #[test]
    fn texels_are_met_at_their_centres_and_mixed_between() {
        let texture = four(false, &[0.0, 1.0, 2.0, 3.0], &[1.5]);
        let uv = [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.5, 0.5], [0.0, 0.0], [9.0, 9.0]];
        assert_eq!(texture.sample(&uv, &[0.0; 6]), [0.0, 1.0, 2.0, 1.5, 0.0, 3.0]);
    }

    #[test]
    fn what_wraps_meets_the_other_side() {
        let texture = four(true, &[0.0, 1.0, 2.0, 3.0], &[1.5]);
        assert_eq!(texture.sample(&[[0.0, 0.25], [1.25, -0.75], [-0.25, 0.25]], &[0.0; 3]), [0.5, 0.0, 1.0]);
    }

    #[test]
    fn levels_are_mixed() {
        let texture = four(true, &[0.0, 1.0, 2.0, 3.0], &[1.5]);
        assert_eq!(texture.sample(&[[0.75, 0.75]; 3], &[0.5, 1.0, 7.0]), [2.25, 1.5, 1.5]);
    }
}
