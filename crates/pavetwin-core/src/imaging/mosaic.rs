//! A picture at the sensor's own pixels: each sees one colour through the Bayer mosaic; the camera interpolates the
//! other two, reduces noise, and sharpens. So neighbouring pixels of photographs are not independent.

use super::film::Film;
use super::noise::Normal;
use super::window::Window;
use super::{Crop, Sensor, channels, channels_mut, in_bands};

/// What the camera makes of a mosaic.
#[derive(Clone, Copy, Debug)]
pub struct Mosaic {
    /// Differences of brightness up to about this many standard deviations of the noise count as noise.
    pub noise_reduction: f32,
    /// Colours are means over squares of this many pixels around, 0 for themselves only.
    pub colour_reach: usize,
}

/// Pixels around that noise reduction looks at: means over 5 × 5.
const REACH: usize = 2;

/// Shares of red, green and blue in brightness.
const LUMA: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Steps of brightness in which the noise is tabulated.
const STEPS: usize = 256;

/// Weights of a Gaussian of one pixel.
const SOFT: [f32; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];

/// A picture of one value a pixel, whose border goes on outwards by two pixels.
struct Padded {
    width: usize,
    values: Vec<f32>,
}

impl Padded {
    /// `make` fills the rows of a picture.
    fn of((width, height): (usize, usize), make: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        let mut inner = vec![0.0_f32; width * height];
        in_bands(width, &mut inner, |first, band| {
            for (row, line) in (first..).zip(band.chunks_exact_mut(width)) {
                make(row, line);
            }
        });
        Self::around((width, height), |row| &inner[row * width..][..width])
    }

    /// Mirrored at the border pixel, which keeps the colours of a mosaic in their places.
    fn around<'a>((width, height): (usize, usize), inner: impl Fn(usize) -> &'a [f32]) -> Self {
        let mirrored = |at: usize, size: usize| {
            let away = at.abs_diff(REACH);
            let inside = if at < REACH { away } else { at - REACH };
            let inside = if inside < size { inside } else { (2 * (size - 1)).saturating_sub(inside) };
            inside.min(size - 1)
        };
        let mut values = Vec::with_capacity((width + 2 * REACH) * (height + 2 * REACH));
        for row in 0..height + 2 * REACH {
            let line = inner(mirrored(row, height));
            values.extend((0..REACH).map(|at| line[mirrored(at, width)]));
            values.extend_from_slice(line);
            values.extend((width + REACH..width + 2 * REACH).map(|at| line[mirrored(at, width)]));
        }
        Self { width, values }
    }

    /// The row `down` below `row` (−2 … 2), from `right` pixels right of its first one on, as long as the picture is
    /// wide.
    fn line(&self, row: usize, down: isize, right: isize) -> &[f32] {
        let at = (row + REACH).wrapping_add_signed(down) * (self.width + 2 * REACH);
        &self.values[(at + REACH).wrapping_add_signed(right)..][..self.width]
    }
}

impl Sensor {
    /// The picture, (height × width × 3) values, of rows of light as `seen` fills them.
    pub(super) fn developed(
        &self,
        mosaic: Mosaic,
        (width, height): (usize, usize),
        crop: Crop,
        seed: u64,
        seen: impl Fn(usize, &mut [f32]) + Sync,
    ) -> Vec<u8> {
        let film = Film::of(self, width, crop, seed);
        let raw = self.photosites((width, height), crop, seed, seen);
        // A row holds brightness, then red less brightness, then blue less brightness.
        let mut tones = vec![0.0_f32; width * height * 3];
        in_bands(width * 3, &mut tones, |first, band| {
            for (row, line) in (first..).zip(band.chunks_exact_mut(width * 3)) {
                interpolated(&raw, &film, self.saturation, crop.corner, row, line);
            }
        });
        let channel = |number: usize| {
            Padded::around((width, height), |row| channels(&tones[row * width * 3..][..width * 3])[number])
        };
        let (bright, reds, blues) = (channel(0), channel(1), channel(2));
        let noise = self.noise_of_tones(&film, mosaic.noise_reduction);
        let quiet = Padded::of((width, height), |row, line| match mosaic.noise_reduction > 0.0 {
            true => reduced(&bright, &noise, row, line),
            false => line.copy_from_slice(bright.line(row, 0, 0)),
        });
        let mut picture = vec![0_u8; width * height * 3];
        in_bands(width * 3, &mut picture, |first, band| {
            let [mut soft, mut red, mut blue] = std::array::from_fn(|_| vec![0.0_f32; width]);
            for (row, stored) in (first..).zip(band.chunks_exact_mut(width * 3)) {
                convolved(&quiet, row, &SOFT, &mut soft);
                mean(&reds, row, mosaic.colour_reach, &mut red);
                mean(&blues, row, mosaic.colour_reach, &mut blue);
                let pixels = red.iter_mut().zip(blue.iter_mut()).zip(soft.iter_mut());
                for (((red, blue), soft), own) in pixels.zip(quiet.line(row, 0, 0)) {
                    let value = own + self.sharpening * (own - *soft);
                    let green = -(LUMA[0] * *red + LUMA[2] * *blue) / LUMA[1];
                    (*red, *soft, *blue) = (byte(value + *red), byte(value + green), byte(value + *blue));
                }
                let stored = stored.chunks_exact_mut(3);
                for (stored, ((red, green), blue)) in stored.zip(red.iter().zip(&soft).zip(&blue)) {
                    stored.copy_from_slice(&[*red as u8, *green as u8, *blue as u8]);
                }
            }
        });
        picture
    }

    /// What the photosites hold, white-balanced shares of saturation: red, green / green, blue.
    fn photosites(
        &self,
        (width, height): (usize, usize),
        crop: Crop,
        seed: u64,
        seen: impl Fn(usize, &mut [f32]) + Sync,
    ) -> Padded {
        let tail = (0.5 * self.blur_px * self.blur_px).min(0.25);
        let normal = Normal::table();
        // Of the middle of the first pixel, as `Film::develop` has it.
        let ((axis_x, axis_y), (across, down)) = (crop.axis(), Crop::whole(crop.frame).axis());
        let (middle_x, middle_y) = (axis_x - 0.5, axis_y - 0.5);
        let corner = ((across - 0.5).powi(2) + (down - 0.5).powi(2)).max(1.0);
        let dark = self.read_electrons * self.read_electrons;
        let mut raw = vec![0.0_f32; width * height];
        in_bands(width, &mut raw, |first, band| {
            let mut lens = Window::over(width, height);
            let (mut light, mut noise) = (vec![0.0_f32; 3 * width], vec![0.0_f32; 3 * width]);
            for (row, line) in (first..).zip(band.chunks_exact_mut(width)) {
                lens.move_to(row, &seen);
                lens.convolved(row, tail, &mut light);
                normal.fill(seed, row * width, channels_mut(&mut noise));
                let (light, noise) = (channels(&light), channels(&noise));
                let y = row as f32 - middle_y;
                for (column, out) in line.iter_mut().enumerate() {
                    let colour = colour_of(column + crop.corner.0, row + crop.corner.1);
                    let x = column as f32 - middle_x;
                    let open = self.electrons_per_light * (1.0 - self.vignetting * (x * x + y * y) / corner);
                    let mean = (light[colour][column] * open).max(0.0);
                    let held = mean + (mean + dark).sqrt() * noise[colour][column];
                    *out = held.clamp(0.0, self.full_electrons) * (self.white_balance[colour] / self.full_electrons);
                }
            }
        });
        Padded::around((width, height), |row| &raw[row * width..][..width])
    }

    /// By brightness, in `STEPS`: `times` the standard deviation of its noise, as the camera knows its sensor.
    fn noise_of_tones(&self, film: &Film<'_>, times: f32) -> Vec<f32> {
        let mut found = vec![0.0_f32; STEPS];
        let mut filled = 0;
        for step in 1..1000 {
            let share = (step as f32 / 1000.0).powi(2);
            let (low, high) = (film.tone(share * 0.98), film.tone(share * 1.02));
            let electrons = share * self.full_electrons;
            let deviation = (electrons + self.read_electrons * self.read_electrons).sqrt() / self.full_electrons;
            let value = times * deviation * (high - low) / (0.04 * share);
            let to = ((film.tone(share) * (STEPS - 1) as f32) as usize).min(STEPS - 1);
            if to >= filled {
                found[filled..=to].fill(value);
                filled = to + 1;
            }
        }
        let last = found[filled.max(1) - 1];
        found[filled..].fill(last);
        found
    }
}

/// What a photosite sees: 0 red, 1 green, 2 blue.
fn colour_of(column: usize, row: usize) -> usize {
    match (row % 2, column % 2) {
        (0, 0) => 0,
        (1, 1) => 2,
        _ => 1,
    }
}

/// One row of tones of a mosaic, its colours interpolated with the gradient of the colour that is there (Malvar, He,
/// Cutler 2004).
fn interpolated(raw: &Padded, film: &Film<'_>, saturation: f32, corner: (usize, usize), row: usize, out: &mut [f32]) {
    let width = raw.width;
    let line = |down: isize, right: isize| raw.line(row, down, right);
    let (own, up, down, left, right) = (line(0, 0), line(-1, 0), line(1, 0), line(0, -1), line(0, 1));
    let (up2, down2, left2, right2) = (line(-2, 0), line(2, 0), line(0, -2), line(0, 2));
    let (a, b, c, d) = (line(-1, -1), line(-1, 1), line(1, -1), line(1, 1));
    let [luma, reds, blues] = channels_mut(out);
    for column in 0..width {
        let centre = own[column];
        let (level, upright) = (left[column] + right[column], up[column] + down[column]);
        let (level2, upright2) = (left2[column] + right2[column], up2[column] + down2[column]);
        let corners = a[column] + b[column] + c[column] + d[column];
        let green = (4.0 * centre + 2.0 * (level + upright) - level2 - upright2) / 8.0;
        let along = (5.0 * centre + 4.0 * level - level2 - corners + 0.5 * upright2) / 8.0;
        let across = (5.0 * centre + 4.0 * upright - upright2 - corners + 0.5 * level2) / 8.0;
        let opposite = (6.0 * centre + 2.0 * corners - 1.5 * (level2 + upright2)) / 8.0;
        let [red, green, blue] = match ((row + corner.1) % 2, (column + corner.0) % 2) {
            (0, 0) => [centre, green, opposite],
            (1, 1) => [opposite, green, centre],
            (0, _) => [along, centre, across],
            _ => [across, centre, along],
        };
        (luma[column], reds[column], blues[column]) = (green, red, blue);
    }
    for ((green, red), blue) in luma.iter_mut().zip(reds.iter_mut()).zip(blues.iter_mut()) {
        let grey = LUMA[0] * *red + LUMA[1] * *green + LUMA[2] * *blue;
        for own in [green, red, blue] {
            *own = Film::place_of(grey + saturation * (*own - grey));
        }
    }
    for ((green, red), blue) in luma.iter_mut().zip(reds).zip(blues) {
        let [own_red, own_green, own_blue] = [*red, *green, *blue].map(|place| film.tone_at(place));
        let bright = LUMA[0] * own_red + LUMA[1] * own_green + LUMA[2] * own_blue;
        (*green, *red, *blue) = (bright, own_red - bright, own_blue - bright);
    }
}

/// A tone as it is stored, before its fraction is cut off.
fn byte(tone: f32) -> f32 {
    tone.clamp(0.0, 1.0) * 255.0 + 0.5
}

/// A row of brightness with its noise reduced: means of the 5 × 5 around, weighted by Tukey's biweight of their
/// difference in standard deviations of the noise, so that edges and stones stay.
fn reduced(bright: &Padded, noise: &[f32], row: usize, out: &mut [f32]) {
    let width = bright.width;
    let own = bright.line(row, 0, 0);
    let inverse: Vec<f32> = own
        .iter()
        .map(|value| 1.0 / noise[((value * (STEPS - 1) as f32).max(0.0) as usize).min(STEPS - 1)].max(1e-6))
        .collect();
    let (mut sum, mut weights) = (own.to_vec(), vec![1.0_f32; width]);
    for down in -(REACH as isize)..=REACH as isize {
        for right in -(REACH as isize)..=REACH as isize {
            if down == 0 && right == 0 {
                continue;
            }
            let near = SOFT[(2 + down) as usize] * SOFT[(2 + right) as usize] / (SOFT[2] * SOFT[2]);
            let other = bright.line(row, down, right);
            let sums = sum.iter_mut().zip(weights.iter_mut());
            for ((sum, weights), (other, (own, inverse))) in sums.zip(other.iter().zip(own.iter().zip(&inverse))) {
                let away = (other - own) * inverse;
                let kept = 1.0 - away * away;
                let kept = if kept > 0.0 { kept } else { 0.0 };
                let weight = near * kept * kept;
                *sum += weight * other;
                *weights += weight;
            }
        }
    }
    for ((out, sum), weight) in out.iter_mut().zip(sum).zip(weights) {
        *out = sum / weight;
    }
}

/// A row convolved with weights both ways.
fn convolved(plane: &Padded, row: usize, weights: &[f32; 5], out: &mut [f32]) {
    let width = plane.width;
    let mut upright = vec![0.0_f32; width + 2 * REACH];
    for (weight, down) in weights.iter().zip(-2_isize..) {
        let at = (row + REACH).wrapping_add_signed(down) * (width + 2 * REACH);
        for (sum, value) in upright.iter_mut().zip(&plane.values[at..][..width + 2 * REACH]) {
            *sum += weight * value;
        }
    }
    for (out, five) in out.iter_mut().zip(upright.windows(5)) {
        *out = five.iter().zip(weights).map(|(value, weight)| value * weight).sum();
    }
}

/// A row of means over the (2 · reach + 1)² around; reach is 2 at most.
fn mean(plane: &Padded, row: usize, reach: usize, out: &mut [f32]) {
    let share = 1.0 / (2 * reach + 1) as f32;
    let weights = std::array::from_fn(|at| if at.abs_diff(2) <= reach { share } else { 0.0 });
    convolved(plane, row, &weights, out);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sensor(noise_reduction: f32, electrons: f32) -> Sensor {
        Sensor {
            electrons_per_light: electrons,
            full_electrons: electrons,
            read_electrons: 0.0,
            vignetting: 0.0,
            blur_px: 0.0,
            white_balance: [1.0; 3],
            saturation: 1.0,
            sharpening: 0.0,
            curve: (0..1024).map(|step| step as f32 / 1023.0).collect(),
            mosaic: Some(Mosaic { noise_reduction, colour_reach: 0 }),
        }
    }

    fn shown(sensor: &Sensor, size: usize, light: impl Fn(usize, usize) -> f32 + Sync) -> Vec<f32> {
        let seen = |row: usize, line: &mut [f32]| {
            for own in channels_mut(line) {
                for (column, own) in own.iter_mut().enumerate() {
                    *own = light(column, row);
                }
            }
        };
        let picture = sensor.developed(sensor.mosaic.unwrap(), (size, size), Crop::whole((size, size)), 5, seen);
        picture.chunks_exact(3).map(|pixel| f32::from(pixel[1])).collect()
    }

    fn deviation(values: &[f32]) -> f32 {
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt()
    }

    #[test]
    fn grey_without_noise_stays_grey_and_slopes_stay_slopes() {
        let picture = shown(&sensor(0.0, 1e9), 24, |column, _| (0.2 + 0.02 * column as f32).powi(2));
        // The curve of this sensor is the root.
        for (at, value) in picture.iter().enumerate().filter(|(at, _)| (3..21).contains(&(at % 24))) {
            assert!((value - 255.0 * (0.2 + 0.02 * (at % 24) as f32)).abs() < 2.0, "{at}: {value}");
        }
    }

    #[test]
    fn noise_becomes_less_and_edges_stay() {
        let light = |column: usize, _| if column < 32 { 0.10 } else { 0.40 };
        let (plain, reduced) = (shown(&sensor(0.0, 4e3), 64, light), shown(&sensor(6.0, 4e3), 64, light));
        let left = |picture: &[f32]| -> Vec<f32> {
            (0..64).flat_map(|row| picture[row * 64 + 4..row * 64 + 28].to_vec()).collect()
        };
        assert!(deviation(&left(&reduced)) < 0.5 * deviation(&left(&plain)));
        let step =
            |picture: &[f32]| -> f32 { (0..64).map(|row| picture[row * 64 + 33] - picture[row * 64 + 30]).sum() };
        assert!(step(&reduced) > 0.95 * step(&plain));
    }
}
