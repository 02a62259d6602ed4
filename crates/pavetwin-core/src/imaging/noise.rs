//! Normal numbers by place: the same at the same pixel under the same seed, whatever the order of work.

use std::sync::LazyLock;

/// Quantiles of the standard normal distribution, in steps of equal chance.
pub struct Normal {
    quantiles: [f32; STEPS],
}

const STEPS: usize = 4096;

static TABLE: LazyLock<Normal> = LazyLock::new(|| Normal {
    quantiles: std::array::from_fn(|step| quantile((step as f64 + 0.5) / STEPS as f64) as f32),
});

impl Normal {
    /// The table, made once.
    pub fn table() -> &'static Self {
        &TABLE
    }

    /// Numbers for the places from `first` on, three for each.
    pub fn fill(&self, seed: u64, first: usize, [ones, others, lasts]: [&mut [f32]; 3]) {
        for (place, ((one, other), last)) in (first as u64..).zip(ones.iter_mut().zip(others).zip(lasts)) {
            [*one, *other, *last] = self.three(seed, place);
        }
    }

    fn three(&self, seed: u64, place: u64) -> [f32; 3] {
        let bits = mixed(seed ^ place.wrapping_mul(0x9e37_79b9_7f4a_7c15));
        [bits, bits >> 20, bits >> 40].map(|bits| self.quantiles[bits as usize % STEPS])
    }
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood 2014).
fn mixed(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// By bisection of the distribution function.
fn quantile(share: f64) -> f64 {
    let (mut low, mut high) = (-6.0, 6.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if distribution(middle) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Of the standard normal: Abramowitz and Stegun 1964, 26.2.17, within 7.5e-8.
fn distribution(x: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * x.abs());
    let series =
        t * (0.319_381_53 + t * (-0.356_563_782 + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let tail = (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt() * series;
    if x >= 0.0 { 1.0 - tail } else { tail }
}

#[cfg(test)]
mod tests {
    use super::Normal;

    #[test]
    fn the_numbers_are_normal() {
        let normal = Normal::table();
        let numbers: Vec<f64> = (0..20_000).flat_map(|place| normal.three(7, place)).map(f64::from).collect();
        let mean = numbers.iter().sum::<f64>() / numbers.len() as f64;
        let variance = numbers.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / numbers.len() as f64;
        let beyond_two = numbers.iter().filter(|x| x.abs() > 2.0).count() as f64 / numbers.len() as f64;
        assert!(mean.abs() < 0.015 && (variance - 1.0).abs() < 0.02 && (beyond_two - 0.0455).abs() < 0.004);
    }

    #[test]
    fn channels_and_places_do_not_repeat_each_other() {
        let normal = Normal::table();
        let [a, b, _] = normal.three(1, 0);
        assert_ne!(a, b);
        assert_ne!(normal.three(1, 0), normal.three(1, 1));
        assert_ne!(normal.three(1, 0), normal.three(2, 0));
    }
}
