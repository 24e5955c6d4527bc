//! Tables of a step response as logs, with the step itself as the input.

use super::channels::{Channel, Log};
use super::error::LogError;
use super::place::neighbours;
use deadtime_signal::time::SampleTime;

/// The input of a log that was made of a step response.
pub const STEP: &str = "step";
/// Samples of rest that are put before a table that begins with the step.
const REST: usize = 20;
/// Samples that an uneven table is read into at most.
const MOST: f64 = 20_000.0;
/// A step this near to a row, as a share of the distance of rows, is at it.
const NEAR: f64 = 1e-3;

impl Log {
    /// The log of a table of a step response: the input [`STEP`] and `response` (default: the only channel) on an even grid.
    ///
    /// The input moves by `size` at `at_s` (default: 0 where the table contains that time, otherwise the table's first row).
    /// A table that begins with the step gets 20 samples of rest before it, at the value of its first row.
    ///
    /// # Errors
    /// [`LogError::UnknownChannel`] and [`LogError::AmbiguousChannel`] for the response; [`LogError::StepTime`] for a step outside the table or between two of its rows.
    pub fn of_step(
        table: &Self,
        response: Option<&str>,
        size: f64,
        at_s: Option<f64>,
    ) -> Result<Self, LogError> {
        let file = || table.source.clone();
        let name = table.only_response(response)?;
        let channel = table.channel(&name)?.clone();
        let alone = Self { channels: vec![channel], ..table.clone() };
        let even = if alone.even_grid().is_ok() { alone } else { alone.on_finest_grid()? };
        let step_s = even.even_grid()?.seconds();
        let (first, last) = (even.start_s(), even.start_s() + even.duration_s());
        let at_s = at_s.unwrap_or(if first <= 0.0 && last > 0.0 { 0.0 } else { first });
        let place = (at_s - first) / step_s;
        let refuse =
            || LogError::StepTime { file: file(), at_s, first_s: first, last_s: last, step_s };
        if !(place.is_finite()
            && place > -NEAR
            && at_s < last
            && (place - place.round()).abs() <= NEAR)
        {
            return Err(refuse());
        }
        let before = place.round() as usize;
        let more = REST.saturating_sub(before);
        let output = even.output(&name)?;
        let start = output.values.first().copied().unwrap_or(0.0);
        let count = even.len() + more;
        let time_s = (0..count).map(|k| first + step_s * (k as f64 - more as f64)).collect();
        let input = (0..count).map(|k| if k < before + more { 0.0 } else { size }).collect();
        let values =
            std::iter::repeat_n(start, more).chain(output.values.iter().copied()).collect();
        let unit = even.unit(&name).map(str::to_owned);
        // The rest is at the first value.
        let there = |k: usize| {
            k < more || output.present.is_none_or(|p| p.get(k - more).copied().unwrap_or(false))
        };
        let present = output.present.is_some().then(|| (0..count).map(there).collect());
        let measured = Channel { present, ..Channel::new(name.as_str(), unit.as_deref(), values) };
        let log = Self::new(file(), time_s, vec![Channel::new(STEP, None, input), measured])?;
        Ok(Self { early_s: even.early_s, ..log })
    }

    /// The channel that is the response: the one that is named, or the only one.
    fn only_response(&self, named: Option<&str>) -> Result<String, LogError> {
        let mut names = self.names();
        match (named, names.next(), names.next()) {
            (Some(name), ..) => Ok(name.to_owned()),
            (None, Some(only), None) => Ok(only.to_owned()),
            (None, first, second) => Err(LogError::AmbiguousChannel {
                file: self.source.clone(),
                channel: "response".into(),
                matches: first.into_iter().chain(second).chain(names).map(str::to_owned).collect(),
            }),
        }
    }

    /// The log on an even grid as fine as its smallest step.
    fn on_finest_grid(&self) -> Result<Self, LogError> {
        let smallest = neighbours(&self.time_s).map(|(a, b)| b - a).fold(f64::INFINITY, f64::min);
        match SampleTime::new(smallest.max(self.duration_s() / MOST)) {
            Ok(step) => self.resample(step, &[]),
            Err(_) => self.even_grid().map(|_| self.clone()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(times: &[f64]) -> Log {
        let y = times.iter().map(|t| if *t < 0.5 { 0.0 } else { 1.0 - (0.5 - t).exp() }).collect();
        Log::new("a.csv", times.to_vec(), vec![Channel::new("y", Some("m"), y)]).unwrap()
    }

    #[test]
    fn a_table_that_begins_with_the_step_gets_rest_before_it() {
        let times: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k)).collect();
        let log = Log::of_step(&table(&times), None, 2.0, None).unwrap();
        assert_eq!(log.len(), 80);
        let u = log.input(STEP).unwrap();
        assert!(u[..20].iter().all(|v| *v == 0.0) && u[20..].iter().all(|v| *v == 2.0));
        assert!((log.time_s()[20]).abs() < 1e-12);
        assert_eq!(log.output("y").unwrap().values[19], 0.0);
        assert_eq!(log.unit("y"), Some("m"));
    }

    #[test]
    fn a_step_inside_the_table_is_where_it_is_said_and_rows_may_be_uneven() {
        let times: Vec<f64> = (-30..60).map(|k| 0.1 * f64::from(k)).collect();
        let log = Log::of_step(&table(&times), Some("y"), 1.0, None).unwrap();
        assert_eq!(
            (log.len(), log.input(STEP).unwrap().iter().position(|v| *v > 0.0)),
            (90, Some(30))
        );
        let uneven: Vec<f64> = (0..40).map(|k| 0.01 * f64::from(k * k)).collect();
        assert!(Log::of_step(&table(&uneven), None, 1.0, None).unwrap().even_grid().is_ok());
    }

    #[test]
    fn a_step_outside_the_table_or_between_rows_is_refused() {
        let times: Vec<f64> = (0..60).map(|k| 0.1 * f64::from(k)).collect();
        for at in [-1.0, 0.25, 9.0, f64::NAN] {
            let said = Log::of_step(&table(&times), None, 1.0, Some(at)).unwrap_err().to_string();
            assert!(said.starts_with("a.csv: the step at"), "{said}");
        }
    }
}
