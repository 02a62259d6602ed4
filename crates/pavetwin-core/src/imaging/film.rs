//! Where light becomes a picture: electrons, their noise, white balance and tone.

use super::noise::Normal;
use super::{Crop, Sensor, channels, channels_mut};

/// Steps of the tone curve as it is looked up: a step is less than a fifth of one of 255.
const TONES: usize = 4096;

/// Added to a number below 4,194,304 this leaves its nearest whole number in the lowest bits.
const WHOLE: f32 = 8_388_608.0;

/// A sensor that develops the rows of one picture.
pub struct Film<'a> {
    sensor: &'a Sensor,
    width: usize,
    crop: Crop,
    seed: u64,
    normal: &'static Normal,
    /// By the square root of the input.
    tones: Vec<f32>,
}

impl<'a> Film<'a> {
    /// For a picture of that width; `seed`: of its noise.
    pub fn of(sensor: &'a Sensor, width: usize, crop: Crop, seed: u64) -> Self {
        let last = (sensor.curve.len() - 1) as f32;
        let tone = |step: usize| {
            let at = step as f32 / (TONES - 1) as f32 * last;
            let low = (at as usize).min(sensor.curve.len() - 2);
            let share = at - low as f32;
            sensor.curve[low] * (1.0 - share) + sensor.curve[low + 1] * share
        };
        Self { sensor, width, crop, seed, normal: Normal::table(), tones: (0..TONES).map(tone).collect() }
    }

    /// The tone of a share of saturation.
    pub fn tone(&self, share: f32) -> f32 {
        self.tone_at(Self::place_of(share))
    }

    /// Where the tone of a share of saturation is looked up.
    pub fn place_of(share: f32) -> f32 {
        share.clamp(0.0, 1.0).sqrt() * (TONES - 1) as f32 + WHOLE
    }

    /// The tone at a place.
    pub fn tone_at(&self, place: f32) -> f32 {
        self.tones[place.to_bits() as usize % TONES]
    }

    /// One row of light as tones, 0 … 1, with its noise. One kind of work at a time, over the whole row.
    pub fn develop(&self, light: &[f32], row: usize, out: &mut [f32]) {
        self.normal.fill(self.seed, row * self.width, channels_mut(out));
        // Of the middle of the first pixel.
        let ((axis_x, axis_y), (across, down)) = (self.crop.axis(), Crop::whole(self.crop.frame).axis());
        let (middle_x, middle_y) = (axis_x - 0.5, axis_y - 0.5);
        let corner = ((across - 0.5).powi(2) + (down - 0.5).powi(2)).max(1.0);
        let y = row as f32 - middle_y;
        let Sensor { electrons_per_light, full_electrons, read_electrons, vignetting, saturation, .. } = *self.sensor;
        let dark = read_electrons * read_electrons;
        for (gain, (light, out)) in self.sensor.white_balance.iter().zip(channels(light).iter().zip(channels_mut(out)))
        {
            let gain = gain / full_electrons;
            for (column, (out, light)) in (0_i32..).zip(out.iter_mut().zip(*light)) {
                let x = column as f32 - middle_x;
                let open = electrons_per_light * (1.0 - vignetting * (x * x + y * y) / corner);
                let mean = (light * open).max(0.0);
                *out = (mean + (mean + dark).sqrt() * *out).clamp(0.0, full_electrons) * gain;
            }
        }
        let [reds, greens, blues] = channels_mut(out);
        for ((red, green), blue) in reds.iter_mut().zip(greens).zip(blues) {
            let grey = 0.2126 * *red + 0.7152 * *green + 0.0722 * *blue;
            for own in [red, green, blue] {
                *own = (grey + saturation * (*own - grey)).clamp(0.0, 1.0).sqrt() * (TONES - 1) as f32 + WHOLE;
            }
        }
        for value in out {
            *value = self.tones[value.to_bits() as usize % TONES];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Crop, Film, Sensor};

    #[test]
    fn light_without_noise_is_its_tone() {
        let sensor = Sensor {
            electrons_per_light: 1e9,
            full_electrons: 1e9,
            read_electrons: 0.0,
            vignetting: 0.0,
            blur_px: 0.0,
            white_balance: [1.0; 3],
            saturation: 1.0,
            sharpening: 0.0,
            curve: vec![0.0, 0.25, 1.0],
            mosaic: None,
        };
        let light = [0.0, 0.0625, 0.25, 0.5625, 1.0, 9.0];
        let film = Film::of(&sensor, 2, Crop::whole((2, 1)), 3);
        let mut out = [0.0; 6];
        film.develop(&light, 0, &mut out);
        for (out, wanted) in out.iter().zip([0.0, 0.125, 0.25, 0.625, 1.0, 1.0]) {
            assert!((out - wanted).abs() < 1e-3, "{out} {wanted}");
        }
    }
}
