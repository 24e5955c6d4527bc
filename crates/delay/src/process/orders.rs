//! One step reveals little of the faster poles. Whether a process model has enough poles is decided by the fits of models with more.
//!
//! Equation: a model is outperformed by one of d more parameters where N·ln(V/V′) > d·ln N (Schwarz's criterion), N the number of independent samples. How it
//! can be wrong: noise hides a pole that still delays the response. Models of few and of many poles are then both used, and differ.
//! Source: Schwarz (1978), Annals of Statistics 6(2), 461-464, doi:10.1214/aos/1176344136.

use crate::estimate::{DelayEstimate, Misfit};
use crate::method::Method;

impl Misfit {
    /// A model of more parameters fits better than Schwarz's penalty allows.
    fn is_outdone(&self, by: &Self) -> bool {
        let gain = by.counting * (self.log_cost - by.log_cost);
        by.parameters > self.parameters
            && gain > (by.parameters - self.parameters) as f64 * by.counting.max(1.0).ln()
    }
}

/// Marks the estimates of process models on a record of one step, or of several inputs. Marked are outperformed models and models with enough poles.
pub(crate) fn judge_orders<'a>(answers: impl Iterator<Item = (&'a Method, &'a mut DelayEstimate)>) {
    let mut fitted: Vec<(&Method, &mut DelayEstimate, Misfit)> =
        answers.filter_map(|(m, e)| e.misfit.as_deref().copied().map(|fit| (m, e, fit))).collect();
    let fits: Vec<(&str, Misfit)> = fitted.iter().map(|(m, _, fit)| (m.entry.name, *fit)).collect();
    for (_, estimate, fit) in &mut fitted {
        match fits.iter().find(|(_, other)| fit.is_outdone(other)) {
            Some((better, _)) => {
                let why = format!(
                    "{better} fits better than its further parameters let expect: lag of poles that this model has not may be in its dead time"
                );
                **estimate = estimate.clone().contradicted(Some(why));
            }
            None => estimate.enough_poles = true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_fit_that_is_better_than_parameters_let_expect_outdoes_one() {
        let fit =
            |cost: f64, parameters| Misfit { log_cost: cost.ln(), counting: 100.0, parameters };
        assert!(fit(1.2, 3).is_outdone(&fit(1.0, 4)));
        // 100·ln(1.02) is 2, ln(100) is 4.6.
        assert!(!fit(1.02, 3).is_outdone(&fit(1.0, 4)));
        assert!(!fit(1.2, 4).is_outdone(&fit(1.0, 4)) && !fit(1.2, 4).is_outdone(&fit(1.0, 3)));
    }
}
