//! Means, medians and the like: one of each, for everybody. Of nothing there is none.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// The normal distribution's 97.5 % point: 95 % lie within so many standard deviations.
pub const NORMAL_95: f64 = 1.96;

/// The same to every digit, for scores that other tools compute alike.
pub const NORMAL_95_EXACT: f64 = 1.959_963_984_540_054;

/// The quantile of Student's t distribution of this many degrees of freedom; `None` where there is none. By bisection of the distribution function: the library's own
/// inverse does not end at some degrees of freedom.
#[must_use]
pub fn students_t(probability: f64, freedom: f64) -> Option<f64> {
    let t = StudentsT::new(0.0, 1.0, freedom).ok().filter(|_| freedom.is_finite())?;
    if !(probability > 0.0 && probability < 1.0) {
        return None;
    }
    let above = probability.max(1.0 - probability);
    let mut end = 1.0;
    while t.cdf(end) < above && end < 1e300 {
        end *= 2.0;
    }
    let (mut from, mut to) = (0.0, end);
    // Each half is exact; the interval ends at neighbouring numbers.
    for _ in 0..1100 {
        let middle = from + 0.5 * (to - from);
        if middle <= from || middle >= to {
            break;
        }
        if t.cdf(middle) < above { from = middle } else { to = middle }
    }
    Some(if probability < 0.5 { -to } else { to })
}

/// The arithmetic mean.
#[must_use]
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) =
        values.into_iter().fold((-0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
    (count > 0.0).then(|| sum / count)
}

/// The mean square about the mean.
#[must_use]
pub fn variance(values: &[f64]) -> Option<f64> {
    let centre = mean(values.iter().copied())?;
    mean(values.iter().map(|v| (v - centre).powi(2)))
}

/// The standard deviation about the mean; the count, not one less, divides.
#[must_use]
pub fn deviation(values: &[f64]) -> Option<f64> {
    variance(values).map(f64::sqrt)
}

/// The root of the mean square.
#[must_use]
pub fn rms(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    mean(values.into_iter().map(|v| v * v)).map(f64::sqrt)
}

/// The median; of an even number of values the mean of the middle two.
#[must_use]
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => None,
        _ if n % 2 == 1 => Some(values[n / 2]),
        _ => Some(0.5 * (values[n / 2 - 1] + values[n / 2])),
    }
}

/// The median; of an even number of values the greater of the middle two, which is one of them.
#[must_use]
pub fn upper_median(mut values: Vec<f64>) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The quantile at `q` between 0 and 1, linear between order statistics (type 7 of Hyndman and Fan, 1996, doi:10.2307/2684934).
#[must_use]
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let at = q.clamp(0.0, 1.0) * last as f64;
    let below = at.floor() as usize;
    let above = (below + 1).min(last);
    Some(sorted[below] + (at - at.floor()) * (sorted[above] - sorted[below]))
}

/// The ends of the 95 % interval of a normal estimate.
#[must_use]
pub fn interval95(centre: f64, std: f64) -> [f64; 2] {
    [centre - NORMAL_95 * std, centre + NORMAL_95 * std]
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// Points of Student's table (Abramowitz and Stegun 1964, table 26.10), to its three digits. The iteration ends for all degrees of freedom, and the points
    /// fall towards the normal one.
    #[test]
    fn points_of_students_table_are_found_at_all_degrees_of_freedom() {
        for (freedom, point) in [
            (1.0, 12.706),
            (2.0, 4.303),
            (5.0, 2.571),
            (10.0, 2.228),
            (30.0, 2.042),
            (120.0, 1.980),
        ] {
            let found = students_t(0.975, freedom).unwrap();
            assert!((found - point).abs() < 6e-4, "{freedom}: {found}");
            assert_relative_eq!(students_t(0.025, freedom).unwrap(), -found, max_relative = 1e-9);
        }
        let all: Vec<f64> = (1..4000).map(|f| students_t(0.975, f64::from(f)).unwrap()).collect();
        assert!(all.windows(2).all(|w| w[1] <= w[0] && w[1] > NORMAL_95_EXACT), "{all:?}");
    }

    #[test]
    fn of_nothing_there_is_none() {
        assert_eq!(
            (mean([]), variance(&[]), median(vec![]), upper_median(vec![]), quantile(&[], 0.5)),
            (None, None, None, None, None)
        );
        assert_eq!((deviation(&[]), rms([])), (None, None));
    }

    #[test]
    fn moments_are_those_of_a_hand_calculation() {
        let values = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0];
        assert_eq!((mean(values), variance(&values)), (Some(5.0), Some(4.0)));
        assert_eq!((deviation(&values), rms([3.0, -4.0, 0.0, 0.0])), (Some(2.0), Some(2.5)));
    }

    #[test]
    fn medians_differ_where_the_count_is_even() {
        let values = vec![4.0, 1.0, 3.0, 2.0];
        assert_eq!((median(values.clone()), upper_median(values)), (Some(2.5), Some(3.0)));
        assert_eq!(
            (median(vec![3.0, 1.0, 2.0]), upper_median(vec![3.0, 1.0, 2.0])),
            (Some(2.0), Some(2.0))
        );
    }

    #[test]
    fn quantiles_interpolate_between_order_statistics() {
        assert_eq!(
            (quantile(&[0.0, 10.0], 0.0), quantile(&[0.0, 10.0], 0.9), quantile(&[0.0, 10.0], 2.0)),
            (Some(0.0), Some(9.0), Some(10.0))
        );
        assert_relative_eq!(quantile(&[4.0, 1.0, 2.0, 3.0], 0.25).unwrap(), 1.75);
    }

    #[test]
    fn an_interval_lies_about_its_centre() {
        let [from, to] = interval95(3.0, 0.5);
        assert_relative_eq!(from, 2.02);
        assert_relative_eq!(to, 3.98);
    }
}
