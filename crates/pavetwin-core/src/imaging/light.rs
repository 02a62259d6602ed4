//! The picture as the graphics device gives it: half floats, red green blue and one that is not used.

/// Light that falls on the sensor, (height × width × 4) half floats in kcd/m².
pub struct Light<'a> {
    pub width: usize,
    pub height: usize,
    pub halves: &'a [u16],
}

impl Light<'_> {
    /// One row's pixels, red green blue.
    pub(super) fn pixels(&self, row: usize) -> impl Iterator<Item = [f32; 3]> {
        let halves = &self.halves[row * self.width * 4..][..self.width * 4];
        halves.chunks_exact(4).map(|pixel| [single(pixel[0]), single(pixel[1]), single(pixel[2])])
    }

    /// One row's reds, then its greens, then its blues.
    pub(super) fn line(&self, row: usize, out: &mut [f32]) {
        let [reds, greens, blues] = super::channels_mut(out);
        for (pixel, ((red, green), blue)) in self.pixels(row).zip(reds.iter_mut().zip(greens).zip(blues)) {
            [*red, *green, *blue] = pixel;
        }
    }

    pub(super) fn pixel(&self, column: usize, row: usize) -> [f32; 3] {
        let at = (row * self.width + column) * 4;
        std::array::from_fn(|channel| single(self.halves[at + channel]))
    }
}

/// A half float's value. What is not a number counts as dark, what is infinite as the largest there is.
fn single(half: u16) -> f32 {
    let magnitude = half & 0x7fff;
    // Moved to where a single's exponent and mantissa lie, then scaled by the difference of the two biases, 2^112.
    let value = f32::from_bits(u32::from(magnitude) << 13) * f32::from_bits(0x7780_0000);
    let number = if magnitude > 0x7c00 { 0.0 } else { value.min(LARGEST) };
    let signed = if half & 0x8000 == 0 { number } else { -number };
    if half == 0xfc00 { 0.0 } else { signed }
}

/// The largest half float.
const LARGEST: f32 = 65504.0;

#[cfg(test)]
mod tests {
    use super::single;

    #[test]
    fn halves_are_read_exactly() {
        for (half, value) in [
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x0001, 5.960_464_5e-8),
            (0x7bff, 65504.0),
            (0x7c00, 65504.0),
            (0x7e00, 0.0),
        ] {
            assert_eq!(single(half), value);
        }
    }
}
