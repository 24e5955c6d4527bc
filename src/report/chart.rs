//! What drawings share: a part with its numbers, and round numbers for an axis.

/// A part of the drawing with the numbers it shows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Panel {
    pub(super) top: f64,
    pub(super) height: f64,
    pub(super) lowest: f64,
    pub(super) highest: f64,
}

impl Panel {
    /// Numbers that are all equal get a range around them.
    pub(super) fn new(top: f64, height: f64, lowest: f64, highest: f64) -> Self {
        let margin = if highest > lowest {
            0.04 * (highest - lowest)
        } else {
            0.5 * highest.abs().max(1e-9)
        };
        Self { top, height, lowest: lowest - margin, highest: highest + margin }
    }

    pub(super) fn y(self, value: f64) -> f64 {
        // Far outside is as good as further outside, and SVG readers stumble over huge numbers.
        let share = ((self.highest - value) / (self.highest - self.lowest)).clamp(-1.0, 2.0);
        self.top + share * self.height
    }
}

/// Round numbers between two, about so many, with their labels.
pub(super) fn ticks(lowest: f64, highest: f64, about: f64) -> Vec<(f64, String)> {
    let width = highest - lowest;
    if !(width.is_finite() && width > 0.0) {
        return Vec::new();
    }
    let rough = width / about.max(1.0);
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0]
        .into_iter()
        .map(|s| s * power)
        .find(|s| *s >= 0.999 * rough)
        .unwrap_or(10.0 * power);
    let first = (lowest / step).ceil();
    let count = ((highest / step).floor() - first).clamp(-1.0, 50.0) + 1.0;
    let decimals = (-step.log10().floor()).clamp(0.0, 12.0) as usize;
    let most = lowest.abs().max(highest.abs());
    let label = |value: f64| {
        if value == 0.0 && !(1e-4..1e6).contains(&most) {
            return "0".to_owned();
        }
        if !(1e-4..1e6).contains(&most) {
            // The same digits for all: those that tell neighbours apart.
            let digits = (most.log10().floor() - step.log10().floor()).clamp(0.0, 6.0) as usize;
            return format!("{value:.digits$e}").replace('-', "−");
        }
        format!("{value:.decimals$}").replace('-', "−")
    };
    let numbers = (0..count as u32).map(|i| (first + f64::from(i)) * step);
    // A zero that rounding made −0 is 0.
    numbers.map(|v| if v.abs() < 1e-9 * step { 0.0 } else { v }).map(|v| (v, label(v))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_their_labels_tell_them_apart() {
        let labels = |l, h| ticks(l, h, 5.0).into_iter().map(|t| t.1).collect::<Vec<_>>();
        assert_eq!(labels(-0.1, 1.05), ["0.0", "0.5", "1.0"]);
        assert_eq!(labels(0.0, 12.0), ["0", "5", "10"]);
        assert_eq!(labels(-1.1e-7, 1.1e-7), ["−1.0e−7", "−5.0e−8", "0", "5.0e−8", "1.0e−7"]);
        assert!(labels(1.0, 1.0).is_empty());
    }
}
