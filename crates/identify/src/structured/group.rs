//! Groups of outputs: a vector's error is a difference, an attitude's the rotation vector between two quaternions.

use deadtime_model::{EquationsFile, GroupKind};
use deadtime_signal::stats;

/// Outputs with a common error measure.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Group {
    pub(super) name: String,
    pub(super) kind: GroupKind,
    /// Indices of the outputs.
    pub(super) outputs: Vec<usize>,
    /// Unit of the error.
    pub(super) unit: Option<String>,
}

impl Group {
    /// The groups of a model: those in its file, then every other output by itself.
    pub(super) fn all(file: &EquationsFile) -> Vec<Self> {
        let at = |name: &String| file.outputs.iter().position(|o| o.name == *name);
        let mut groups: Vec<Self> = file
            .groups
            .iter()
            .map(|(name, entry)| {
                let outputs: Vec<usize> = entry.outputs.iter().filter_map(at).collect();
                let unit = match entry.kind {
                    GroupKind::Attitude => Some("rad".to_owned()),
                    GroupKind::Vector => {
                        outputs.first().and_then(|&i| file.outputs[i].unit.clone())
                    }
                };
                Self { name: name.clone(), kind: entry.kind, outputs, unit }
            })
            .collect();
        for (i, output) in file.outputs.iter().enumerate() {
            if !groups.iter().any(|g| g.outputs.contains(&i)) {
                groups.push(Self {
                    name: output.name.clone(),
                    kind: GroupKind::Vector,
                    outputs: vec![i],
                    unit: output.unit.clone(),
                });
            }
        }
        groups
    }

    /// The combined standard deviation of its outputs in a record's rows × `outputs` samples; 1 for constant outputs. NaN is a missing sample.
    pub(super) fn spread(&self, y: &[f64], outputs: usize) -> f64 {
        let variance = |&i: &usize| {
            let seen = y.iter().skip(i).step_by(outputs).copied().filter(|v| !v.is_nan());
            stats::variance(&seen.collect::<Vec<f64>>()).unwrap_or(0.0)
        };
        let whole = self.outputs.iter().map(variance).sum::<f64>().sqrt();
        if whole > 0.0 { whole } else { 1.0 }
    }

    /// Components of the error.
    pub(super) fn size(&self) -> usize {
        match self.kind {
            GroupKind::Vector => self.outputs.len(),
            GroupKind::Attitude => 3,
        }
    }

    /// Prediction minus log, and its derivatives along `count` directions from those of the outputs (`tangents`, row by row). Returns whether the row has all
    /// outputs of the group: a missing one is NaN.
    pub(super) fn error(
        &self,
        y: &[f64],
        tangents: &[f64],
        count: usize,
        logged: &[f64],
        e: &mut [f64],
        de: &mut [f64],
    ) -> bool {
        if self.outputs.iter().any(|&i| logged[i].is_nan()) {
            return false;
        }
        match self.kind {
            GroupKind::Vector => {
                for (k, &i) in self.outputs.iter().enumerate() {
                    e[k] = y[i] - logged[i];
                    de[k * count..(k + 1) * count]
                        .copy_from_slice(&tangents[i * count..(i + 1) * count]);
                }
            }
            GroupKind::Attitude => {
                let of = |from: &dyn Fn(usize) -> f64| [0, 1, 2, 3].map(|k| from(self.outputs[k]));
                let reference = of(&|i| logged[i]);
                let between = difference(reference, of(&|i| y[i]));
                let (vector, slopes) = rotation(between);
                e[..3].copy_from_slice(&vector);
                for j in 0..count {
                    let d = difference(reference, of(&|i| tangents[i * count + j]));
                    for k in 0..3 {
                        de[k * count + j] = (0..4).map(|c| slopes[k][c] * d[c]).sum();
                    }
                }
            }
        }
        true
    }
}

/// conj(a)·b of quaternions with the scalar last.
fn difference(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    let [ax, ay, az, aw] = a;
    let [bx, by, bz, bw] = b;
    [
        aw * bx - ax * bw - ay * bz + az * by,
        aw * by + ax * bz - ay * bw - az * bx,
        aw * bz - ax * by + ay * bx - az * bw,
        aw * bw + ax * bx + ay * by + az * bz,
    ]
}

/// The rotation vector of a quaternion of any length, for the shorter rotation, and its derivatives by the quaternion's entries.
fn rotation(q: [f64; 4]) -> ([f64; 3], [[f64; 4]; 3]) {
    let sign = if q[3] < 0.0 { -1.0 } else { 1.0 };
    let [x, y, z, s] = q.map(|v| v * sign);
    let v = [x, y, z];
    let n = (x * x + y * y + z * z).sqrt();
    // Below this angle the series' next term is below rounding.
    const SMALL: f64 = 1e-5;
    let (factor, slope_n, slope_s) = if n < SMALL * s {
        (2.0 / s, 0.0, -2.0 / (s * s))
    } else {
        let angle = 2.0 * n.atan2(s);
        let square = n * n + s * s;
        // ∂(θ/n)/∂n divided by n, for ∂n = v·∂v/n.
        (angle / n, (2.0 * s / square - angle / n) / (n * n), -2.0 / square)
    };
    let vector = v.map(|c| c * factor);
    let mut slopes = [[0.0; 4]; 3];
    for k in 0..3 {
        for c in 0..3 {
            slopes[k][c] = sign * (v[k] * slope_n * v[c] + if k == c { factor } else { 0.0 });
        }
        slopes[k][3] = sign * v[k] * slope_s;
    }
    (vector, slopes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rotation_vector_of_a_quarter_turn_is_half_pi_about_its_axis_whatever_the_sign_and_the_length()
     {
        let h = 0.5_f64.sqrt();
        for scale in [1.0, -1.0, 1.7] {
            let (v, _) = rotation([0.0, h * scale, 0.0, h * scale]);
            assert!(
                (v[1] - std::f64::consts::FRAC_PI_2).abs() < 1e-14 && v[0] == 0.0 && v[2] == 0.0,
                "{v:?}"
            );
        }
    }

    #[test]
    fn derivatives_of_the_rotation_vector_agree_with_differences() {
        for q in [
            [0.3, -0.2, 0.5, 0.7],
            [0.3, -0.2, 0.5, -0.7],
            [1e-7, 2e-7, -1e-7, 1.0],
            [0.1, 0.9, 0.2, 0.05],
        ] {
            let (_, slopes) = rotation(q);
            for c in 0..4 {
                let h = 1e-6;
                let mut moved = [q, q];
                moved[0][c] -= h;
                moved[1][c] += h;
                let [low, high] = moved.map(|q| rotation(q).0);
                for k in 0..3 {
                    let by_difference = (high[k] - low[k]) / (2.0 * h);
                    assert!(
                        (slopes[k][c] - by_difference).abs() < 1e-6,
                        "{q:?} {k} {c}: {} {by_difference}",
                        slopes[k][c]
                    );
                }
            }
        }
    }
}
