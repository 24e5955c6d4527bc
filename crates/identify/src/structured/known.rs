//! Uncertainty of an estimate: combinations that are not identifiable, pairs that are correlated, values that are not physical.

use deadtime_signal::decompositions::symmetric_eigen;
use nalgebra::{DMatrix, DVector, SymmetricEigen};
use serde::Serialize;

use deadtime_signal::stats::NORMAL_95;

/// One-step and many-step estimates differ when their ratio is above this, or a nominal value moved by more than [`MOVED`].
const APART: f64 = 2.0;
/// A nominal value that moved by this factor no longer represents that quantity.
const MOVED: f64 = 10.0;
/// A correlation above this value is reported.
const TRADE: f64 = 0.95;
/// A direction whose information is below this share of the best one moves predictions 1e-6 as much, which no log resolves. Without noise, a vanishing residual
/// would make every such direction certain.
pub(crate) const RESOLVED: f64 = 1e-12;
/// Components of a direction below this share of its largest are left out of its description.
const PART: f64 = 0.25;

/// The interpretation of a value as the named quantity.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Standing {
    /// One-step and many-step estimates agree within a factor of two, and the nominal value has not moved tenfold.
    Physical,
    /// The value predicts well without being physical: the two estimates differ, or the nominal value moved tenfold.
    Surrogate,
    /// Not tested: windows of one step were not fitted, or their estimates are too uncertain to agree or to disagree.
    Unchecked,
    /// Correlated with another parameter, or with an interval from zero to twice its value.
    Open,
    /// The data do not determine the value, and a prior keeps it at the file's.
    Held,
}

/// A combination of parameters that the data do not determine, or only vaguely.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Unseen {
    /// The parameters and their components in it, in shares of each one's size.
    pub parts: Vec<(String, f64)>,
    /// Standard deviation along it: 1 is the parameters' own size.
    pub std: f64,
    /// A description.
    pub words: String,
}

/// An estimate of several parameters, each in its size.
pub(crate) struct Known<'a> {
    pub(crate) names: Vec<&'a str>,
    /// The size of a unit step of each.
    pub(crate) sizes: Vec<f64>,
    pub(crate) values: Vec<f64>,
    /// In sizes.
    pub(crate) information: DMatrix<f64>,
    /// In sizes.
    pub(crate) covariance: DMatrix<f64>,
    /// The basis of the estimate, with its verb: "the logs do".
    pub(crate) source: &'static str,
}

impl Known<'_> {
    /// Directions whose standard deviation is at least the parameters' own size: the null space of the information at the accuracy of the data.
    pub(crate) fn unseen(&self) -> Vec<Unseen> {
        let count = self.names.len();
        let eigen = symmetric_eigen(&self.information).unwrap_or_else(|| SymmetricEigen {
            eigenvectors: DMatrix::identity(count, count),
            eigenvalues: DVector::zeros(count),
        });
        let mut found: Vec<Unseen> = Vec::new();
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
        for k in order {
            let resolved = eigen.eigenvalues[k] > RESOLVED * eigen.eigenvalues.max();
            let std = 1.0 / eigen.eigenvalues[k].max(f64::MIN_POSITIVE).sqrt();
            let std = if resolved { std } else { std.max(1.0) };
            if std < 1.0 {
                break;
            }
            let direction = eigen.eigenvectors.column(k);
            let largest = direction.iter().map(|v| v.abs()).fold(0.0, f64::max);
            let parts: Vec<(usize, f64)> = (0..count)
                .map(|j| (j, direction[j] / largest))
                .filter(|(_, v)| v.abs() >= PART)
                .collect();
            let words = self.words(&parts);
            found.push(Unseen {
                parts: parts.iter().map(|&(j, v)| (self.names[j].to_owned(), v)).collect(),
                std,
                words,
            });
        }
        found
    }

    fn words(&self, parts: &[(usize, f64)]) -> String {
        let name = |j: usize| self.names[j];
        // A ratio or a product is constant where the relative changes are equal.
        let relative = |&(j, v): &(usize, f64)| v * self.sizes[j] / self.values[j];
        match parts {
            [(j, _)] => format!("{}, which {} not show", name(*j), self.source),
            [a, b]
                if (relative(a).abs() - relative(b).abs()).abs()
                    < 0.1 * relative(a).abs().max(relative(b).abs()) =>
            {
                let what = if relative(a) * relative(b) > 0.0 { "ratio" } else { "product" };
                format!("{} and {} one by one, only their {what}", name(a.0), name(b.0))
            }
            _ => {
                let part = |&(j, v): &(usize, f64)| format!("{v:+.2} {}", name(j));
                let list: Vec<String> = parts.iter().map(part).collect();
                format!("the combination {} (in shares of each parameter's size)", list.join(", "))
            }
        }
    }

    /// Pairs with a correlation above [`TRADE`], in words, and the parameters of such a pair with a wide interval.
    pub(crate) fn trades(&self) -> (Vec<String>, Vec<bool>) {
        let (count, v) = (self.names.len(), &self.covariance);
        let (mut said, mut traded) = (Vec::new(), vec![false; count]);
        let share = |j: usize| {
            self.sizes[j] * v[(j, j)].max(0.0).sqrt() / self.values[j].abs().max(f64::MIN_POSITIVE)
        };
        for a in 0..count {
            for b in a + 1..count {
                let correlation = v[(a, b)] / (v[(a, a)] * v[(b, b)]).max(f64::MIN_POSITIVE).sqrt();
                if correlation.abs() > TRADE && share(a).max(share(b)) > 0.1 {
                    said.push(format!(
                        "{} and {} are correlated ({correlation:.3}), with standard deviations of {:.0} % and {:.0} %",
                        self.names[a],
                        self.names[b],
                        100.0 * share(a),
                        100.0 * share(b)
                    ));
                    [a, b].into_iter().filter(|&j| share(j) > 0.5).for_each(|j| traded[j] = true);
                }
            }
        }
        (said, traded)
    }
}

/// A value, or the smallest indistinguishable value that is at least `least`.
pub(crate) fn at_least(value: f64, least: f64) -> f64 {
    if value.abs() < least { least } else { value }
}

/// The interpretation of a value; `lost` for a parameter in an unidentifiable combination, or correlated with another. Values below `least` are equivalent: a
/// dead time of a small part of a sample is zero.
pub(crate) fn standing(
    nominal: f64,
    [value, std]: [f64; 2],
    one_step: Option<[f64; 2]>,
    lost: bool,
    least: f64,
) -> Standing {
    let value = at_least(value, least);
    let one_step = one_step.map(|[once, spread]| [at_least(once, least), spread]);
    // An interval that holds 0 and twice the value is uninformative.
    if lost || NORMAL_95 * std >= value.abs() {
        return Standing::Open;
    }
    let moved = nominal != 0.0 && {
        let ratio = value / nominal;
        !(1.0 / MOVED..=MOVED).contains(&ratio)
    };
    let Some([once, spread]) = one_step else {
        return if moved { Standing::Surrogate } else { Standing::Unchecked };
    };
    let unlike = !(1.0 / APART..=APART).contains(&(once / value));
    if moved || unlike && (once - value).abs() > NORMAL_95 * std.hypot(spread) {
        return Standing::Surrogate;
    }
    // A one-step interval as wide as the value itself holds zero and twice the value, which is no agreement.
    if unlike || NORMAL_95 * spread >= value.abs() {
        Standing::Unchecked
    } else {
        Standing::Physical
    }
}

#[cfg(test)]
mod tests {
    use super::{Standing, standing};

    #[test]
    fn a_vague_value_from_single_steps_is_no_witness() {
        let of =
            |once: f64, spread: f64| standing(0.0, [0.79, 0.13], Some([once, spread]), false, 0.0);
        // An offset of the shipped quadrotor, from fits of real flights: the one-step estimate 11 ± 14 is no agreement with 0.79.
        assert_eq!(of(11.2, 7.0), Standing::Unchecked);
        assert_eq!(of(-25.6, 26.5), Standing::Unchecked);
        // The estimates are close, but would be for any value up to twice this one.
        assert_eq!(of(0.8, 0.6), Standing::Unchecked);
        assert_eq!(of(0.8, 0.2), Standing::Physical);
        assert_eq!(of(11.2, 0.5), Standing::Surrogate);
        assert_eq!(standing(0.0, [0.79, 0.5], Some([0.8, 0.2]), false, 0.0), Standing::Open);
        assert_eq!(
            standing(0.01, [0.79, 0.13], Some([11.2, 7.0]), false, 0.0),
            Standing::Surrogate
        );
        assert_eq!(standing(0.0, [0.79, 0.13], None, false, 0.0), Standing::Unchecked);
    }
}
