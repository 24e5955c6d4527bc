//! Commands with too little excitation: constant, one frequency, slower than the model's dynamics, or two that are collinear.

use deadtime_signal::decompositions::symmetric_eigen;
use deadtime_signal::dft;
use nalgebra::{Complex, DMatrix, DVector};

use super::evidence::{Evidence, result, short};
use super::moments::deviation;
use super::moments::mean;
use super::view::View;
use crate::format::diagnosis::{Check, CheckKind};

/// Eigenvalues of the delayed command's covariance below this part of the largest count as 0: for a pure sine these eigenvalues are rounding errors.
const RANK: f64 = 1e-9;
/// Delayed copies of the command in the test.
const COPIES: usize = 8;
/// A command with this many independent delayed copies (a sine has 2) determines one gain and one phase.
const POOR: usize = 2;
/// The largest change of a command within the slowest time constant, in its standard deviations; below it only a static gain can be seen.
const CHANGES: f64 = 0.1;
/// Two commands that are one: the part of the one that the others explain.
const TOGETHER: f64 = 0.98;
/// The term added to the diagonal of the correlations, so that copies stay solvable.
const RIDGE: f64 = 1e-9;
/// An input takes part in what another follows where its coefficient is at least this part of the largest.
const TAKES_PART: f64 = 0.1;
/// More inputs than this are counted, not named.
const MOST_NAMED: usize = 4;
/// The part of the power that a command's band holds.
const POWER: f64 = 0.9;
/// More values than this are not counted as levels.
const LEVELS: usize = 12;

pub(super) fn check(e: &Evidence<'_>) -> Vec<Check> {
    let view = &e.view;
    let inputs: Vec<Vec<Vec<f64>>> =
        (0..view.system.inputs.len()).map(|j| records(view, j)).collect();
    let followed = followed(&inputs);
    let one = |j: usize| {
        let name = &view.system.inputs[j].name;
        let (ok, finding) = judge(view, &inputs, followed[j].as_ref(), j);
        result(CheckKind::Excitation, name, Some(ok), finding)
    };
    (0..inputs.len()).map(one).collect()
}

/// One input over the training spans, each record about its mean.
fn records(view: &View<'_>, input: usize) -> Vec<Vec<f64>> {
    view.records
        .iter()
        .map(|r| {
            (0..r.time_s.len())
                .filter(|&k| r.train.is_some_and(|s| s.holds(r.time_s[k])))
                .map(|k| r.inputs[input][k])
                .collect()
        })
        .collect()
}

/// Whether one command excites the model enough, and the finding.
fn judge(
    view: &View<'_>,
    inputs: &[Vec<Vec<f64>>],
    followed: Option<&Followed>,
    j: usize,
) -> (bool, String) {
    let port = &view.system.inputs[j];
    let name = &port.name;
    let unit = port.unit.as_deref().filter(|u| *u != "1").map(|u| format!(" {u}"));
    let unit = unit.unwrap_or_default();
    let u = &inputs[j];
    let (low, high) = u
        .iter()
        .flatten()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(*v), h.max(*v)));
    if !u.iter().any(|r| deviation(r) > 0.0) {
        return (
            false,
            format!(
                "`{name}` is constant ({}{unit}): its effect cannot be identified; record a log in which it moves",
                short(low)
            ),
        );
    }
    let levels = levels(u);
    let mut says = vec![format!("`{name}` moves from {} to {}{unit}", short(low), short(high))];
    says.extend(properties(view, u, levels));
    let faults = faults(view, u, followed);
    let ok = faults.is_empty();
    says.extend(faults);
    if levels <= 3 {
        says.push(
            "with one amplitude a dead zone, a limit and a gain look the same: use two or more"
                .to_owned(),
        );
    }
    (ok, says.join("; "))
}

/// The number of values that a command has.
fn levels(u: &[Vec<f64>]) -> usize {
    let mut levels: Vec<f64> = u.iter().flatten().copied().collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    levels.len()
}

/// The number of levels where they are few, the command's band, and the model's time constants.
fn properties(view: &View<'_>, u: &[Vec<f64>], levels: usize) -> Vec<String> {
    let mut says = Vec::new();
    if levels <= LEVELS {
        says.push(format!("in {levels} levels"));
    }
    let band_hz = u.iter().filter_map(|r| band_hz(r, view.sample_time_s())).fold(0.0, f64::max);
    says.push(format!("{} % of its power below {} Hz", short(100.0 * POWER), short(band_hz)));
    let constants = &view.time_constants_s;
    if let (Some(fast), Some(slow)) = (constants.first(), constants.last()) {
        let [fast, slow] = [*fast, *slow].map(short);
        says.push(match fast == slow {
            true => format!("the model's time constant is {slow} s"),
            false => format!("the model's time constants are {fast} to {slow} s"),
        });
    }
    says
}

/// The faults of a command that moves, each with its fix.
fn faults(view: &View<'_>, u: &[Vec<f64>], followed: Option<&Followed>) -> Vec<String> {
    let mut says = Vec::new();
    let slowest = view.time_constants_s.last();
    if slowest.is_some_and(|slowest| changes(u, slowest / view.sample_time_s()) < CHANGES) {
        says.push(
            "it changes so slowly that only a static gain shows: use steps or a faster command"
                .to_owned(),
        );
    } else if rank(u, view) <= POOR {
        says.push("it is one frequency, which tells one gain and one phase: use steps, a multisine or a sweep".to_owned());
    }
    if let Some(Followed { share, by }) = followed.filter(|f| f.share > TOGETHER) {
        let name = |&k: &usize| format!("`{}`", view.system.inputs[k].name);
        let mut names: Vec<String> = by.iter().take(MOST_NAMED).map(name).collect();
        if by.len() > MOST_NAMED {
            names.push(format!("{} more", by.len() - MOST_NAMED));
        }
        says.push(format!(
            "{} of it follows {}: their effects are indistinguishable; move them one at a time",
            short(*share),
            names.join(", ")
        ));
    }
    says
}

/// The frequency below which most of the power is.
fn band_hz(u: &[f64], sample_time_s: f64) -> Option<f64> {
    let n = u.len();
    let centre = mean(u.iter().copied());
    let mut values: Vec<Complex<f64>> = u.iter().map(|v| Complex::new(v - centre, 0.0)).collect();
    dft(&mut values);
    let power: Vec<f64> = values.iter().take(n / 2 + 1).skip(1).map(Complex::norm_sqr).collect();
    let total: f64 = power.iter().sum();
    let mut sum = 0.0;
    let bin = power.iter().position(|p| {
        sum += p;
        sum >= POWER * total
    })?;
    (total > 0.0).then(|| (bin + 1) as f64 / (n as f64 * sample_time_s))
}

/// The largest change over a time, in standard deviations.
fn changes(u: &[Vec<f64>], samples: f64) -> f64 {
    let of = |r: &Vec<f64>| {
        let lag = (samples.round().max(1.0) as usize).min(r.len() / 2);
        r.iter().zip(r.iter().skip(lag)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
            / deviation(r)
    };
    u.iter().filter(|r| deviation(r) > 0.0).map(of).fold(0.0, f64::max)
}

/// The number of the command's delayed copies that are independent (persistency of excitation; Ljung 1999, "System Identification", 2nd ed., section 13.2).
fn rank(u: &[Vec<f64>], view: &View<'_>) -> usize {
    let fast = view.time_constants_s.first().copied().unwrap_or(0.0);
    let lag = ((0.5 * fast / view.sample_time_s()).round().max(1.0) as usize)
        .min(u.iter().map(Vec::len).min().unwrap_or(0) / (4 * COPIES));
    let lag = lag.max(1);
    let mut gram: DMatrix<f64> = DMatrix::zeros(COPIES, COPIES);
    for r in u {
        // Changes over a lag: independent of the mean.
        let changes: Vec<f64> = r.iter().zip(r.iter().skip(lag)).map(|(a, b)| b - a).collect();
        for window in changes.windows((COPIES - 1) * lag + 1) {
            for i in 0..COPIES {
                for j in 0..COPIES {
                    gram[(i, j)] += window[i * lag] * window[j * lag];
                }
            }
        }
    }
    let Some(eigen) = symmetric_eigen(&gram) else { return 0 };
    let largest = eigen.eigenvalues.max();
    eigen.eigenvalues.iter().filter(|v| **v > RANK * largest).count()
}

/// The part of an input that the other moving inputs explain.
struct Followed {
    /// The multiple correlation with all of them.
    share: f64,
    /// Those that take part, the largest coefficient first.
    by: Vec<usize>,
}

/// Per input; `None` where it does not move or no other one does.
///
/// The diagonal of the inverse correlation matrix is `1/(1 - R^2)`, its rows are the coefficients of the regressions (Marquardt 1970, Technometrics 12(3), 591).
fn followed(inputs: &[Vec<Vec<f64>>]) -> Vec<Option<Followed>> {
    let mut all: Vec<Option<Followed>> = inputs.iter().map(|_| None).collect();
    let moving: Vec<usize> =
        (0..inputs.len()).filter(|&k| inputs[k].iter().any(|r| deviation(r) > 0.0)).collect();
    let standard = |k: usize| {
        let centred = inputs[k].iter().flat_map(|r| {
            let centre = mean(r.iter().copied());
            r.iter().map(move |v| v - centre)
        });
        let column = DVector::from_iterator(inputs[k].iter().map(Vec::len).sum(), centred);
        let size = column.norm();
        column / size
    };
    let n = moving.len();
    if n < 2 {
        return all;
    }
    let columns = DMatrix::from_columns(&moving.iter().map(|&k| standard(k)).collect::<Vec<_>>());
    let correlation = columns.tr_mul(&columns) + DMatrix::identity(n, n) * RIDGE;
    let Some(inverse) = correlation.cholesky().map(|c| c.inverse()) else {
        return all;
    };
    for (at, &j) in moving.iter().enumerate() {
        let coefficient = |k: usize| inverse[(at, k)].abs();
        let mut others: Vec<usize> = (0..n).filter(|&k| k != at).collect();
        others.sort_by(|&a, &b| coefficient(b).total_cmp(&coefficient(a)));
        let largest = others.first().map_or(0.0, |&k| coefficient(k));
        others.retain(|&k| coefficient(k) >= TAKES_PART * largest);
        all[j] = Some(Followed {
            share: (1.0 - 1.0 / inverse[(at, at)]).max(0.0).sqrt(),
            by: others.into_iter().map(|k| moving[k]).collect(),
        });
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values without a pattern, -1 to 1 (Weyl's sequence).
    fn irregular(step: f64, n: usize) -> Vec<f64> {
        (1..=n).map(|k| 2.0 * (step * (k * k) as f64).fract() - 1.0).collect()
    }

    #[test]
    fn an_input_follows_those_that_it_is_made_of_and_no_others() {
        let n = 400;
        let mut inputs: Vec<Vec<f64>> =
            (1..=60).map(|j| irregular((0.618_033_988_75 * f64::from(j)).fract(), n)).collect();
        inputs[7] = inputs[3].iter().zip(&inputs[40]).map(|(a, b)| 5.0 + 2.0 * a - b).collect();
        inputs[8] = vec![1.0; n];
        let inputs: Vec<Vec<Vec<f64>>> = inputs.into_iter().map(|u| vec![u]).collect();
        let all = followed(&inputs);
        assert!(all[8].is_none(), "a constant follows nothing");
        let of = |j: usize| all[j].as_ref().map(|f| (f.share, f.by.clone())).unwrap();
        assert!(of(7).0 > 0.999_999, "{:?}", of(7));
        assert_eq!(of(7).1, [3, 40]);
        assert!(of(3).0 > 0.999_999 && of(3).1[..2] == [7, 40], "{:?}", of(3));
        for j in (0..60).filter(|j| ![3, 7, 8, 40].contains(j)) {
            assert!(of(j).0 < 0.9 * TOGETHER, "{j}: {:?}", of(j));
        }
    }
}
