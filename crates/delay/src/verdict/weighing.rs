//! The verdict on the estimates of many methods for one pair.

use super::answer::{FoundDelay, Said};
use super::conclusion::{Grounds, RecordFacts, Verdict};
use super::number::Number;
use super::refusal::{refused, too_soon};
use super::votes::Group;
use super::words::{left_out, outcomes, who};
use crate::estimate::Outcome;
use crate::finding::Finding;
use deadtime_signal::time::SampleTime;

/// Weights the estimates for one pair. Within a class of `answers` the most trusted method comes first; `findings` are the conditions of the record.
///
/// A verdict without a dead time has one of three causes. No method found a delay. The methods that withstand every noise and feedback detect no response. The
/// input moves once, no method can be trusted, and many delays fit a process model.
///
/// Excluded are methods that do not withstand the record's conditions, and estimates that their own residuals contradict. Without other estimates, these are
/// used, except under feedback. Where most votes are for a delay shorter than the plant allows, and the record has no direct path, such estimates are excluded,
/// too.
///
/// Each class of methods has one vote ([`crate::Class::vote_weight`]). Those of its methods that found a delay share it by the inverse square of their errors in
/// the study. Methods with the same intermediate result ([`crate::Basis`]) share one part of it. The delay inside the intervals with most votes defines a group
/// of estimates.
///
/// Value and interval come from mixtures of the group's estimates whose methods led in the study. The value is the median, each estimate weighted by its
/// method's error there. The interval also contains that of the mixture weighted by votes. Where other inputs have effects, the models of all inputs alone give
/// value and interval; the other methods add their votes.
#[must_use]
pub fn verdict(
    answers: &[Said<'_>],
    findings: &[Finding],
    sample_time: SampleTime,
    facts: &RecordFacts,
) -> Verdict {
    let found: Vec<FoundDelay<'_>> = answers
        .iter()
        .filter_map(|answer| FoundDelay::new(answer, findings, sample_time))
        .collect();
    match Counted::of(&found, answers, findings, facts) {
        Ok(counted) => counted.verdict(&found, answers, facts),
        Err(why) => Verdict::none(why),
    }
}

/// The used estimates, grouped.
struct Counted<'a, 'b> {
    group: Group<'a, 'b>,
    /// No method can be trusted: all are used.
    nobody: bool,
    /// Estimates within the sample were excluded.
    implausible: bool,
}

impl<'a, 'b> Counted<'a, 'b> {
    /// The used estimates, or why there is no dead time.
    fn of(
        found: &'b [FoundDelay<'a>],
        answers: &[Said<'_>],
        findings: &[Finding],
        facts: &RecordFacts,
    ) -> Result<Self, String> {
        let mut counted: Vec<&FoundDelay<'_>> =
            found.iter().filter(|f| f.distrust.is_empty() && !f.contradicted).collect();
        if let Some(why) = refused((found, counted.len()), answers, findings, facts.one_step) {
            return Err(why);
        }
        let nobody = counted.is_empty();
        if nobody {
            counted = found.iter().collect();
        }
        let mut group = Group::of(&counted);
        // A plant with a relative degree of one sample does not respond within it, unless the record contains a direct path.
        let implausible = !facts.direct && group.within() > 0.5;
        if implausible {
            counted.retain(|f| !f.within);
            if counted.is_empty() {
                return Err(too_soon(found));
            }
            group = Group::of(&counted);
        }
        Ok(Self { group, nobody, implausible })
    }

    /// The verdict of the group, with all remarks on the estimates.
    fn verdict(
        &self,
        found: &[FoundDelay<'_>],
        answers: &[Said<'_>],
        facts: &RecordFacts,
    ) -> Verdict {
        let Group { agree, differ, .. } = &self.group;
        let number = Number::of(&self.group, facts);
        let chosen = number.chosen.method;
        let others: Vec<&str> =
            agree.iter().map(|(f, _)| f.method).filter(|method| *method != chosen).collect();
        let agreeing = std::iter::once(chosen).chain(others.iter().copied());
        let mut grounds = Grounds {
            agree: agreeing.map(str::to_owned).collect(),
            differ: differ.iter().map(|(f, _)| (f.method.to_owned(), f.delay_s)).collect(),
            direct: number.direct,
            doubts: Vec::new(),
        };
        let mut why = who(chosen, &others, differ);
        if self.nobody {
            grounds.doubt(
                &mut why,
                "no method is made for this record, or the data contradict its model: treat the number as a guess",
            );
        }
        if number.of_all_inputs {
            why.push_str(
                "; number and interval are those of the models that fit all inputs together",
            );
        }
        why.push_str(&left_out(found, self.nobody, self.implausible));
        if number.direct {
            why.push_str("; the output reacts within the sample: a direct path, and no dead time");
        }
        let silent =
            outcomes(answers, |e| !matches!(e.outcome, Outcome::Found | Outcome::NotApplicable));
        if !silent.is_empty() {
            why.push_str(&format!("; {silent}"));
        }
        let total = |side: &[(&FoundDelay<'_>, f64)]| side.iter().map(|(_, w)| w).sum::<f64>();
        if total(differ) >= total(agree) {
            grounds.doubt(
                &mut why,
                "the methods disagree: check excitation, feedback and the search window before using the number",
            );
        }
        Verdict {
            delay_s: Some(number.delay_s),
            ci95_s: Some(number.interval_s),
            why,
            method: Some(chosen.to_owned()),
            grounds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::DelayEstimate;
    use crate::method::Condition;
    use crate::methods::method;
    use approx::assert_abs_diff_eq;
    use deadtime_signal::stats::NORMAL_95;

    fn answer(delay_s: f64, std_s: f64) -> DelayEstimate {
        DelayEstimate {
            delay_s: Some(delay_s),
            std_s: Some(std_s),
            ci95_s: Some([delay_s - 2.0 * std_s, delay_s + 2.0 * std_s]),
            outcome: Outcome::Found,
            ..DelayEstimate::without(Outcome::Found, "")
        }
    }

    fn of(answers: &[(&str, &DelayEstimate)], findings: &[Finding]) -> Verdict {
        let answers: Vec<Said<'_>> =
            answers.iter().map(|(m, e)| (method(m).unwrap(), *e, None)).collect();
        verdict(&answers, findings, SampleTime::new(0.01).unwrap(), &RecordFacts::default())
    }

    fn shows(condition: Condition) -> Vec<Finding> {
        vec![Finding { condition, evidence: String::new().into() }]
    }

    #[test]
    fn the_delay_that_more_classes_hold_wins_over_the_more_trusted_loner() {
        let (a, b, c) = (answer(1.0, 0.01), answer(2.0, 0.1), answer(2.1, 0.1));
        let v = of(&[("oestruc", &a), ("threshold", &b), ("state_least_squares", &c)], &[]);
        // The threshold has two thirds of the weight, by 1/2.49² and 1/3.5².
        let delay_s = v.delay_s.unwrap();
        assert!(delay_s > 2.0 && delay_s < 2.05, "{delay_s}");
        assert!(
            v.why.starts_with("weighted median of threshold, state_least_squares")
                && v.why.contains("oestruc 1.0000 s"),
            "{}",
            v.why
        );
    }

    #[test]
    fn a_step_that_no_model_of_few_poles_fits_has_no_verdict_where_many_delays_fit_one_of_more() {
        let few = answer(1.0, 0.1).contradicted(Some("p2d fits better".to_owned()));
        let many = DelayEstimate::without(
            Outcome::Flat,
            "delays from 3.2 to 24.9 samples fit equally well",
        );
        let said: Vec<Said<'_>> =
            vec![(method("p1d").unwrap(), &few, None), (method("p3d").unwrap(), &many, None)];
        let v = |one_step| {
            verdict(
                &said,
                &[],
                SampleTime::new(0.1).unwrap(),
                &RecordFacts { one_step, ..RecordFacts::default() },
            )
        };
        assert_eq!((v(true).delay_s, v(false).delay_s), (None, Some(1.0)));
        assert!(
            v(true).why.contains("p3d says delays from 3.2 to 24.9 samples"),
            "{}",
            v(true).why
        );
    }

    #[test]
    fn methods_of_one_class_share_their_vote() {
        let (sharp, early, early_too) = (answer(2.0, 0.1), answer(1.0, 0.1), answer(1.0, 0.1));
        let v =
            of(&[("oestruc", &sharp), ("threshold", &early), ("threshold_step", &early_too)], &[]);
        assert_eq!(v.delay_s, Some(2.0), "two thresholds on one response are one vote: {}", v.why);
        assert!(v.why.contains("threshold 1.0000 s; threshold_step 1.0000 s"), "{}", v.why);
    }

    #[test]
    fn methods_of_two_classes_that_read_one_model_share_their_vote() {
        let (wrong, right) = (answer(1.0, 0.1), answer(2.0, 0.1));
        // arxdap reads the polynomials of the scan whose losses arxstruc reads. Together they have half of the class's vote; the full vote of p2d exceeds it.
        let v = of(
            &[("arxstruc", &wrong), ("delayest", &wrong), ("arxdap", &wrong), ("p2d", &right)],
            &[],
        );
        assert_eq!(v.delay_s, Some(2.0), "{}", v.why);
        let v = of(
            &[("arxstruc", &wrong), ("oestruc", &wrong), ("lagudap", &wrong), ("p2d", &right)],
            &[],
        );
        // Models with a basis of their own have votes of their own.
        assert_abs_diff_eq!(v.delay_s.unwrap(), 1.0, epsilon = 1e-9);
    }

    #[test]
    fn a_vague_answer_moves_the_median_little() {
        let (vague, sharp, late) = (answer(0.0, 8.0), answer(2.0, 0.5), answer(12.0, 4.0));
        let v =
            of(&[("threshold", &vague), ("oestruc", &sharp), ("state_least_squares", &late)], &[]);
        let [from, to] = v.ci95_s.unwrap();
        assert_abs_diff_eq!(v.delay_s.unwrap(), 2.0, epsilon = 0.01);
        assert!(from > 0.7 && from < 1.2 && to > 2.8 && to < 3.3, "{from} to {to}");
    }

    #[test]
    fn an_answer_more_certain_than_the_data_let_expect_does_not_decide() {
        let (bold, plain, other) = (answer(5.0, 0.01), answer(7.0, 1.2), answer(7.2, 1.2));
        let (p2d, oestruc, arxdap) =
            (method("p2d").unwrap(), method("oestruc").unwrap(), method("arxdap").unwrap());
        let weighed = |expected: Option<f64>| {
            let answers =
                [(p2d, &bold, expected), (oestruc, &plain, expected), (arxdap, &other, expected)];
            verdict(&answers, &[], SampleTime::new(0.01).unwrap(), &RecordFacts::default())
        };
        // Its own standard deviation gives it no weight. The estimate has 0.37 of the mixture; by hand calculation, the others have the remainder of a half
        // below 6.08.
        for expected in [None, Some(2.0)] {
            assert_abs_diff_eq!(weighed(expected).delay_s.unwrap(), 6.08, epsilon = 0.05);
        }
    }

    #[test]
    fn the_interval_is_that_of_the_leading_methods_of_those_that_agree() {
        let (narrow, wide, widest) = (answer(2.0, 0.1), answer(2.1, 0.3), answer(2.0, 2.0));
        let ends = |answers: &[(&str, &DelayEstimate)]| of(answers, &[]).ci95_s.unwrap();
        let two = ends(&[("oestruc", &narrow), ("p2d", &wide)]);
        // Half of the mixture each. Beyond these ends the narrower one has no mass, and the wider one Φ⁻¹(0.95) = 1.6449 of its standard deviations,
        // 0.3·2/1.96.
        let half = 1.6449 * 0.3 * 2.0 / NORMAL_95;
        assert_abs_diff_eq!(two[0], 2.1 - half, epsilon = 1e-3);
        assert_abs_diff_eq!(two[1], 2.1 + half, epsilon = 1e-3);
        // In the study its error exceeded the limit for two correlated methods.
        assert_eq!(two, ends(&[("oestruc", &narrow), ("p2d", &wide), ("lagudap", &widest)]));
    }

    #[test]
    fn what_another_grid_made_early_is_inside_the_interval() {
        let (at, method) = (answer(2.0, 0.1), method("oestruc").unwrap());
        let v = verdict(
            &[(method, &at, None)],
            &[],
            SampleTime::new(0.1).unwrap(),
            &RecordFacts { early_s: 0.3, ..RecordFacts::default() },
        );
        assert_eq!((v.delay_s, v.ci95_s), (Some(2.0), Some([1.8, 2.5])));
    }

    #[test]
    fn a_method_that_does_not_withstand_the_record_is_not_counted_and_the_reason_is_said() {
        let (open, closed) = (answer(1.0, 0.1), answer(2.0, 0.1));
        let v = of(
            &[("oestruc", &open), ("threshold", &open), ("arxstruc", &closed)],
            &shows(Condition::Feedback),
        );
        assert_eq!(v.delay_s, Some(2.0));
        assert!(v.why.contains("left out because of feedback: oestruc, threshold"), "{}", v.why);
        let v = of(&[("oestruc", &open), ("threshold", &open)], &shows(Condition::Feedback));
        assert_eq!(v.delay_s, None, "a loop makes sharp answers wrong");
        assert!(v.why.contains("add a random binary signal to the command"), "{}", v.why);
        let v = of(&[("threshold", &open)], &shows(Condition::ColouredNoise));
        assert_eq!(v.delay_s, Some(1.0), "better a guess than nothing, and said");
        assert!(v.why.contains("as a guess"), "{}", v.why);
        let freed = DelayEstimate { open_part: true, ..open };
        let v = of(&[("oestruc", &freed), ("threshold", &freed)], &shows(Condition::Feedback));
        assert_eq!(v.delay_s, Some(1.0), "what the output did not cause is free of feedback");
        assert!(
            v.why.starts_with("oestruc alone")
                && v.why.contains("left out because of coloured noise: threshold"),
            "{}",
            v.why
        );
    }

    #[test]
    fn an_answer_within_the_sample_counts_where_the_record_shows_a_direct_path() {
        let within = DelayEstimate {
            raw_delay_s: Some(0.0),
            degree_bias_samples: 1.0,
            ..answer(0.0, 0.001)
        };
        let later = DelayEstimate {
            raw_delay_s: Some(0.04),
            degree_bias_samples: 1.0,
            ..answer(0.03, 0.005)
        };
        let said = [("oestruc", &within), ("arxdap", &within), ("p2d", &later)]
            .map(|(m, e)| (method(m).unwrap(), e, None));
        let v = |direct| {
            verdict(
                &said,
                &[],
                SampleTime::new(0.01).unwrap(),
                &RecordFacts { direct, ..RecordFacts::default() },
            )
        };
        assert_eq!((v(true).delay_s, v(false).delay_s), (Some(0.0), Some(0.03)));
        assert!(v(true).why.contains("a direct path, and no dead time"), "{}", v(true).why);
        assert!(
            v(false).why.contains(
                "answer within the sample, where the record shows no direct path: oestruc, arxdap"
            ),
            "{}",
            v(false).why
        );
        let alone =
            verdict(&said[..2], &[], SampleTime::new(0.01).unwrap(), &RecordFacts::default());
        assert!(
            alone.delay_s.is_none()
                && alone.why.contains("sooner than a strictly proper plant answers"),
            "{}",
            alone.why
        );
    }

    #[test]
    fn with_other_inputs_the_models_of_all_inputs_resolve_the_fraction_and_the_rest_vote() {
        let fitted = |at: f64, std: f64| DelayEstimate { enough_poles: true, ..answer(at, std) };
        let (p1d, p2d, whole, outdone) =
            (fitted(0.618, 0.001), fitted(0.616, 0.013), answer(0.6, 0.03), answer(0.64, 0.05));
        let said = [
            ("arxstruc", &whole),
            ("oestruc", &whole),
            ("p1d", &p1d),
            ("p2d", &p2d),
            ("p3d", &outdone),
        ]
        .map(|(m, e)| (method(m).unwrap(), e, None));
        let v = |others_act, said: &[Said<'_>]| {
            verdict(
                said,
                &[],
                SampleTime::new(0.1).unwrap(),
                &RecordFacts { others_act, ..RecordFacts::default() },
            )
        };
        let (several, alone) = (v(true, &said), v(false, &said));
        // Each is at least the tolerance of its method, 0.1 samples.
        let fine = (0.618 / 1e-4 + 0.616 / 1.69e-4) / (1e4 + 1.0 / 1.69e-4);
        assert_abs_diff_eq!(several.delay_s.unwrap(), fine, epsilon = 5e-4);
        let [from, to] = several.ci95_s.unwrap();
        assert!(from > 0.59 && to < 0.643, "{from} to {to}");
        let [wider, later] = alone.ci95_s.unwrap();
        assert!(wider < from && later > to, "with one input all who agree count: {}", alone.why);
        // Where most votes hold another delay, the resolution of two models does not decide.
        let far = answer(0.9, 0.03);
        let most = [("arxstruc", &far), ("threshold", &far), ("arxdap", &far), ("p1d", &p1d)]
            .map(|(m, e)| (method(m).unwrap(), e, None));
        assert_abs_diff_eq!(v(true, &most).delay_s.unwrap(), 0.9, epsilon = 1e-9);
    }

    #[test]
    fn an_answer_that_its_own_residuals_contradict_is_not_used() {
        let (sharp, plain) = (
            answer(1.0, 0.001).contradicted(Some("the leftovers follow the input".to_owned())),
            answer(2.0, 0.1),
        );
        let v = of(&[("p2d", &sharp), ("oestruc", &plain)], &[]);
        assert_eq!(v.delay_s, Some(2.0));
        assert!(v.why.contains("the data contradict their model: p2d"), "{}", v.why);
    }

    #[test]
    fn a_response_that_the_methods_against_every_noise_do_not_see_has_no_verdict() {
        let (none, found) = (DelayEstimate::without(Outcome::NotVisible, ""), answer(1.0, 0.1));
        let v = of(&[("oestruc", &found), ("arxstruc", &none), ("armaxstruc", &none)], &[]);
        assert_eq!(v.delay_s, None);
        assert!(
            v.why.starts_with("arxstruc, armaxstruc withstand")
                && v.why.ends_with("oestruc 1.0000 s"),
            "{}",
            v.why
        );
        let v = of(&[("oestruc", &found), ("arxstruc", &none), ("armaxstruc", &found)], &[]);
        assert_eq!(v.delay_s, Some(1.0), "one of them sees it");
        let v = of(&[("oestruc", &found), ("arxstruc", &none)], &[]);
        assert_eq!(v.delay_s, Some(1.0), "one alone may be of too low an order");
    }

    #[test]
    fn without_a_delay_found_there_is_no_verdict() {
        let none = DelayEstimate::without(Outcome::NotVisible, "");
        let v = of(&[("oestruc", &none), ("arxstruc", &none)], &[]);
        assert_eq!(v.delay_s, None);
        assert!(v.why.contains("not visible: oestruc, arxstruc"), "{}", v.why);
    }
}
