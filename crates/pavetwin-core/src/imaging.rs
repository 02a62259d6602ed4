//! From the light that a lens lets through to the picture that a camera stores: lens blur, motion over the exposure,
//! vignetting, electrons and their noise, white balance, tone, sharpening, 8 bits.

mod edges;
mod light;
mod motion;
mod noise;

pub use light::Light;
pub use motion::Motion;

use edges::Tones;
use noise::Normal;

/// What the camera does to light. Light is in kcd/m², colours are linear sRGB until the tone curve.
#[derive(Clone, Debug)]
pub struct Sensor {
    /// Electrons of one output pixel for each kcd/m², over the exposure.
    pub electrons_per_light: f32,
    /// Electrons at which a pixel is full, at this ISO.
    pub full_electrons: f32,
    /// Standard deviation of the electronics, in electrons.
    pub read_electrons: f32,
    /// Share of the light that is missing in the corners.
    pub vignetting: f32,
    /// Standard deviation of the lens's point spread in pixels.
    pub blur_px: f32,
    /// Gains of red, green and blue.
    pub white_balance: [f32; 3],
    /// Distance of colours from grey, 1 as they are.
    pub saturation: f32,
    /// How much of the difference to its neighbours is added to a pixel.
    pub sharpening: f32,
    /// Output 0 … 1 at inputs (i / (n − 1))², so that the dark end is fine.
    pub curve: Vec<f32>,
}

/// Rows are worked on in bands, on all cores; the result does not depend on how many there are.
fn in_bands<T: Send>(rows: usize, row_length: usize, out: &mut [T], work: impl Fn(usize, &mut [T]) + Sync) {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get()).min(8);
    let band = rows.div_ceil(cores).max(1);
    std::thread::scope(|scope| {
        for (index, chunk) in out.chunks_mut(band * row_length).enumerate() {
            let work = &work;
            scope.spawn(move || {
                for (row, line) in chunk.chunks_mut(row_length).enumerate() {
                    work(index * band + row, line);
                }
            });
        }
    });
}

impl Sensor {
    /// The picture, (height × width × 3) values of sRGB.
    pub fn expose(&self, light: &Light<'_>, motion: Option<&Motion<'_>>, seed: u64) -> Vec<u8> {
        let (width, height) = (light.width, light.height);
        let mut plane = vec![0.0_f32; width * height * 3];
        in_bands(height, width * 3, &mut plane, |row, line| light.line(row, line));
        let mut other = vec![0.0_f32; plane.len()];
        let tones = self.tones(&plane, width, height);
        in_bands(height, width * 3, &mut other, |row, line| tones.smooth(&plane, row, line));
        std::mem::swap(&mut plane, &mut other);
        if let Some(motion) = motion {
            in_bands(height, width * 3, &mut other, |row, line| motion.gather(&plane, (width, height), row, line));
            std::mem::swap(&mut plane, &mut other);
        }
        let mut blurred = other;
        let tail = (0.5 * self.blur_px * self.blur_px).min(0.25);
        in_bands(height, width * 3, &mut blurred, |row, line| three_by_three(&plane, width, height, row, tail, line));
        let normal = Normal::table();
        in_bands(height, width * 3, &mut plane, |row, line| {
            self.develop(&blurred[row * width * 3..][..width * 3], (width, height), row, seed, normal, line);
        });
        let mut picture = vec![0_u8; plane.len()];
        in_bands(height, width * 3, &mut picture, |row, line| {
            // The neighbours' weights of a small Gaussian: what sharpening takes for the blurred picture.
            let mut soft = vec![0.0_f32; line.len()];
            three_by_three(&plane, width, height, row, 0.25, &mut soft);
            let own = &plane[row * width * 3..][..width * 3];
            for ((stored, own), soft) in line.iter_mut().zip(own).zip(soft) {
                let value = own + self.sharpening * (own - soft);
                *stored = (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
            }
        });
        picture
    }

    /// Tones that the picture will have, to find edges in: before noise and white balance.
    fn tones(&self, plane: &[f32], width: usize, height: usize) -> Tones {
        let scale = self.electrons_per_light / self.full_electrons;
        Tones::of(width, height, |row, line| {
            for (tone, rgb) in line.iter_mut().zip(plane[row * width * 3..].chunks_exact(3)) {
                // The square root stands in for the tone curve.
                *tone = (scale * (0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2])).clamp(0.0, 1.0).sqrt();
            }
        })
    }

    /// One row of light as tones, 0 … 1, with its noise.
    fn develop(
        &self,
        light: &[f32],
        (width, height): (usize, usize),
        row: usize,
        seed: u64,
        normal: &Normal,
        out: &mut [f32],
    ) {
        let (middle_x, middle_y) = (0.5 * (width as f32 - 1.0), 0.5 * (height as f32 - 1.0));
        let corner = (middle_x * middle_x + middle_y * middle_y).max(1.0);
        let y = row as f32 - middle_y;
        let gains = self.white_balance.map(|gain| gain / self.full_electrons);
        let dark = self.read_electrons * self.read_electrons;
        // One kind of work at a time over the whole row, which a processor does for many values at once.
        let mut luck = vec![0.0_f32; light.len()];
        for (column, luck) in luck.chunks_exact_mut(3).enumerate() {
            luck.copy_from_slice(&normal.three(seed, (row * width + column) as u64));
        }
        for (column, (light, out)) in light.chunks_exact(3).zip(out.chunks_exact_mut(3)).enumerate() {
            let x = column as f32 - middle_x;
            let open = self.electrons_per_light * (1.0 - self.vignetting * (x * x + y * y) / corner);
            (out[0], out[1], out[2]) = (light[0] * open, light[1] * open, light[2] * open);
        }
        for (value, luck) in out.iter_mut().zip(&luck) {
            let mean = value.max(0.0);
            *value = (mean + (mean + dark).sqrt() * luck).clamp(0.0, self.full_electrons);
        }
        for rgb in out.chunks_exact_mut(3) {
            let [r, g, b] = [rgb[0] * gains[0], rgb[1] * gains[1], rgb[2] * gains[2]];
            let grey = 0.2126 * r + 0.7152 * g + 0.0722 * b;
            for (value, own) in rgb.iter_mut().zip([r, g, b]) {
                *value = grey + self.saturation * (own - grey);
            }
        }
        for value in out.iter_mut() {
            *value = value.clamp(0.0, 1.0).sqrt();
        }
        for value in out.iter_mut() {
            *value = self.tone(*value);
        }
    }

    /// The tone curve at a value whose square root this is.
    fn tone(&self, root: f32) -> f32 {
        let at = root * (self.curve.len() - 1) as f32;
        let low = (at as usize).min(self.curve.len() - 2);
        let share = at - low as f32;
        self.curve[low] * (1.0 - share) + self.curve[low + 1] * share
    }
}

/// One row convolved with (tail, 1 − 2·tail, tail) both ways; edges go on outwards.
fn three_by_three(plane: &[f32], width: usize, height: usize, row: usize, tail: f32, out: &mut [f32]) {
    let line = |row: usize| &plane[row * width * 3..][..width * 3];
    let (above, here, below) = (line(row.saturating_sub(1)), line(row), line((row + 1).min(height - 1)));
    let centre = 1.0 - 2.0 * tail;
    // With the first and the last pixel once more beyond the ends.
    let mut upright = vec![0.0_f32; width * 3 + 6];
    for (sum, ((above, below), here)) in upright[3..].iter_mut().zip(above.iter().zip(below).zip(here)) {
        *sum = tail * (above + below) + centre * here;
    }
    upright.copy_within(3..6, 0);
    upright.copy_within(width * 3..width * 3 + 3, width * 3 + 3);
    for (out, ((left, middle), right)) in out.iter_mut().zip(upright.iter().zip(&upright[3..]).zip(&upright[6..])) {
        *out = tail * (left + right) + centre * middle;
    }
}

#[cfg(test)]
mod tests;
