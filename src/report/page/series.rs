//! Curves inside a page: thinned to the resolution of a screen, 16 bits a sample.

use std::fmt::Write as _;

use serde_json::{Value, json};

/// Samples thinned by buckets: of each bucket the least and the greatest value, in the order in which they come. Every curve of a log is thinned alike, so that all share one time axis.
#[derive(Debug, Clone, Copy)]
pub(super) struct Thinning {
    samples: usize,
    bucket: usize,
}

/// Points of all curves of a page together: 2.7 bytes each, so that a page stays below 3 MB.
const POINTS: usize = 800_000;
/// Between this many sample times and a whole number of them, a time axis is even.
const EVEN: f64 = 1e-6;
/// Points of a curve of means.
const MEANS: usize = 2000;
/// The code of a missing sample; values have those below.
const MISSING: u16 = u16::MAX;

impl Thinning {
    /// This number of samples as at most this number of points; all of them where they are fewer.
    pub(super) fn new(samples: usize, points: usize) -> Self {
        let bucket = if samples <= points { 1 } else { (2 * samples).div_ceil(points.max(2)) };
        Self { samples, bucket }
    }

    /// The same for one of several logs of a page with so many curves: its share of the points that a page may hold.
    pub(super) fn share(time_s: &[f64], curves: usize, samples_of_all: usize) -> Self {
        let step = time_s.windows(2).next().map_or(0.0, |w| w[1] - w[0]);
        let even = time_s.windows(2).all(|w| (w[1] - w[0] - step).abs() <= 1e-3 * step);
        // Times that are written one by one take four curves' room.
        let curves = if even { curves } else { curves + 4 };
        Self::new(
            time_s.len(),
            (POINTS / curves.max(1) * time_s.len() / samples_of_all.max(1)).max(64),
        )
    }

    /// Samples of which two points are shown; 1 where all are.
    pub(super) fn bucket(self) -> usize {
        self.bucket
    }

    fn buckets(self) -> impl Iterator<Item = (usize, usize)> {
        let Self { samples, bucket } = self;
        (0..samples.div_ceil(bucket)).map(move |b| (b * bucket, ((b + 1) * bucket).min(samples)))
    }

    /// The times of the points, as start and step where they are even.
    pub(super) fn times(self, time_s: &[f64]) -> Value {
        let time_s = &time_s[..self.samples.min(time_s.len())];
        let points: Vec<f64> = if self.bucket == 1 {
            time_s.to_vec()
        } else {
            self.buckets()
                .filter_map(|(from, to)| {
                    Some([*time_s.get(from)?, *time_s.get(from.midpoint(to).min(to - 1))?])
                })
                .flatten()
                .collect()
        };
        let count = points.len();
        let (Some(first), Some(last)) = (points.first(), points.last()) else {
            return json!({ "from": 0.0, "step": 0.0, "count": 0 });
        };
        let step = (last - first) / (count.max(2) - 1) as f64;
        let even = points
            .iter()
            .enumerate()
            .all(|(i, t)| (t - first - step * i as f64).abs() <= EVEN * step);
        if even && count > 1 {
            json!({ "from": first, "step": step, "count": count })
        } else {
            json!({ "f64": base64(points.iter().flat_map(|t| t.to_le_bytes())) })
        }
    }

    /// The points of a curve, `None` where samples are missing; what lies outside `within` is drawn at its ends.
    pub(super) fn curve(self, value: impl Fn(usize) -> Option<f64>, within: [f64; 2]) -> Value {
        let value =
            |i: usize| value(i).filter(|v| v.is_finite()).map(|v| v.clamp(within[0], within[1]));
        let points: Vec<Option<f64>> = if self.bucket == 1 {
            (0..self.samples).map(value).collect()
        } else {
            self.buckets().flat_map(|(from, to)| extremes(from, to, &value)).collect()
        };
        let [low, high] = points
            .iter()
            .flatten()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)]);
        if low > high {
            return json!({ "low": 0.0, "high": 0.0, "u16": base64(points.iter().flat_map(|_| MISSING.to_le_bytes())) });
        }
        let scale = if high > low { f64::from(MISSING - 1) / (high - low) } else { 0.0 };
        let code = |v: &Option<f64>| v.map_or(MISSING, |v| ((v - low) * scale).round() as u16);
        json!({ "low": low, "high": high, "u16": base64(points.iter().flat_map(|v| code(v).to_le_bytes())) })
    }
}

/// The least and the greatest value of a bucket, in the order in which they come.
fn extremes(from: usize, to: usize, value: &impl Fn(usize) -> Option<f64>) -> [Option<f64>; 2] {
    let mut found: Option<[(usize, f64); 2]> = None;
    for (i, v) in (from..to).filter_map(|i| Some((i, value(i)?))) {
        let [least, greatest] = found.unwrap_or([(i, v); 2]);
        found = Some([
            if v < least.1 { (i, v) } else { least },
            if v > greatest.1 { (i, v) } else { greatest },
        ]);
    }
    match found {
        None => [None, None],
        Some([least, greatest]) if least.0 <= greatest.0 => [Some(least.1), Some(greatest.1)],
        Some([least, greatest]) => [Some(greatest.1), Some(least.1)],
    }
}

/// Six digits: the resolution of a picture.
pub(super) fn brief(value: f64) -> Option<f64> {
    format!("{value:.5e}").parse().ok().filter(|v: &f64| v.is_finite())
}

/// The same of every value.
pub(super) fn briefly(values: impl IntoIterator<Item = f64>) -> Vec<Option<f64>> {
    values.into_iter().map(brief).collect()
}

/// Means of neighbouring values, NaN left out; at most [`MEANS`] of them.
pub(super) fn thinned(values: &[f64]) -> Vec<Option<f64>> {
    let parts = values.chunks(values.len().div_ceil(MEANS).max(1));
    let mean = |part: &[f64]| {
        let known = || part.iter().filter(|v| !v.is_nan());
        brief(known().sum::<f64>() / known().count() as f64)
    };
    parts.map(mean).collect()
}

/// A name with its unit, as the label of an axis; nothing where the unit is 1.
pub(super) fn labelled(name: &str, unit: Option<&str>) -> String {
    unit.filter(|u| *u != "1").map_or_else(|| name.to_owned(), |u| format!("{name} ({u})"))
}

/// A figure with pickers for the keys of its views; none without views.
pub(super) fn picked(id: &str, pick: &[&str], views: Vec<Value>) -> Option<Value> {
    (!views.is_empty()).then(|| json!({ "id": id, "pick": pick, "views": views }))
}

/// RFC 4648, section 4.
pub(super) fn base64(bytes: impl Iterator<Item = u8>) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let bytes: Vec<u8> = bytes.collect();
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let whole =
            three.iter().enumerate().fold(0_u32, |sum, (i, b)| sum | u32::from(*b) << (16 - 8 * i));
        for i in 0..4 {
            let letter = if i <= three.len() {
                char::from(LETTERS[(whole >> (18 - 6 * i) & 63) as usize])
            } else {
                '='
            };
            let _ = text.write_char(letter);
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

    fn decoded(text: &str) -> Vec<u8> {
        let value = |c: u8| {
            b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
                .iter()
                .position(|l| *l == c)
        };
        let bits: Vec<usize> = text.bytes().filter_map(value).collect();
        let mut bytes = Vec::new();
        for four in bits.chunks(4) {
            let whole = four.iter().enumerate().fold(0, |sum, (i, b)| sum | b << (18 - 6 * i));
            bytes.extend((0..four.len() - 1).map(|i| (whole >> (16 - 8 * i) & 255) as u8));
        }
        bytes
    }

    fn values(curve: &Value) -> Vec<Option<f64>> {
        let (low, high) = (curve["low"].as_f64().unwrap(), curve["high"].as_f64().unwrap());
        let bytes = decoded(curve["u16"].as_str().unwrap());
        let one = |b: &[u8]| match u16::from_le_bytes([b[0], b[1]]) {
            MISSING => None,
            code => Some(low + (high - low) * f64::from(code) / 65534.0),
        };
        bytes.chunks(2).map(one).collect()
    }

    #[test]
    fn base64_is_that_of_the_rfc() {
        // Section 10 of RFC 4648.
        for (plain, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(plain.bytes()), coded);
        }
    }

    #[test]
    fn what_fits_is_kept_and_a_missing_sample_stays_missing() {
        let y = [Some(1.0), None, Some(-1.0), Some(f64::NAN), Some(0.5)];
        let read = values(&Thinning::new(5, 10).curve(|i| y[i], ALL));
        assert_eq!((read[1], read[3]), (None, None));
        for (a, b) in [(read[0], 1.0), (read[2], -1.0), (read[4], 0.5)] {
            assert!((a.unwrap() - b).abs() < 2e-5, "{read:?}");
        }
        assert_eq!(values(&Thinning::new(3, 10).curve(|_| None, ALL)), [None; 3]);
        assert_eq!(values(&Thinning::new(2, 10).curve(|_| Some(4.0), ALL)), [Some(4.0); 2]);
    }

    #[test]
    fn thinning_keeps_extremes_in_their_order_and_far_outliers_stay_inside_the_range() {
        let mut y = vec![0.5; 1_000_000];
        (y[433_000], y[433_001]) = (1.0, 0.0);
        y[900_000] = 1e30;
        let thinning = Thinning::new(y.len(), 20_000);
        let read = values(&thinning.curve(|i| Some(y[i]), [0.0, 2.0]));
        assert!(read.len() <= 20_000, "{}", read.len());
        let at = read.iter().position(|v| v.is_some_and(|v| (v - 1.0).abs() < 1e-4)).unwrap();
        assert!(
            read[at + 1].unwrap() < 1e-4 && at.is_multiple_of(2),
            "{:?}",
            &read[at - 2..at + 4]
        );
        assert!((read.iter().flatten().fold(0.0_f64, |a, b| a.max(*b)) - 2.0).abs() < 1e-9);
        let time: Vec<f64> = (0..y.len()).map(|i| i as f64 * 0.01).collect();
        let times = thinning.times(&time);
        assert_eq!(times["count"].as_u64().map(|n| n as usize), Some(read.len()), "{times}");
    }

    #[test]
    fn means_leave_missing_samples_out() {
        let values: Vec<f64> = (0..8000)
            .map(|k| if k % 4 == 1 || k < 4 { f64::NAN } else { (k / 4) as f64 })
            .collect();
        let read = thinned(&values);
        assert_eq!(
            (read.len(), read[0], read[1], read[1999]),
            (2000, None, Some(1.0), Some(1999.0))
        );
    }

    #[test]
    fn uneven_times_are_kept() {
        let times = Thinning::new(3, 10).times(&[0.0, 0.1, 0.35]);
        let bytes = decoded(times["f64"].as_str().unwrap());
        assert_eq!(
            bytes.chunks(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect::<Vec<_>>(),
            [0.0, 0.1, 0.35]
        );
        assert_eq!(
            Thinning::new(3, 10).times(&[1.0, 1.5, 2.0]),
            json!({ "from": 1.0, "step": 0.5, "count": 3 })
        );
    }
}
