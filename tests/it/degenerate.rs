//! Estimators on records that are legal and leave nothing to estimate: an answer without NaN, or a refusal; never a panic.

use deadtime::delay::{Events, Experiment, METHODS, Recording, Scope, Search, Series};
use deadtime::time::SampleTime;
use rayon::prelude::*;
use serde_json::json;

const SAMPLES: usize = 64;

/// Command, response, and which samples of the response are there.
type Record = (&'static str, Vec<f64>, Vec<f64>, Option<Vec<bool>>);

fn records() -> Vec<Record> {
    let of = |f: &dyn Fn(usize) -> f64| (0..SAMPLES).map(f).collect::<Vec<f64>>();
    let noise = |seed: usize| of(&|k| ((k * 7919 + seed * 104_729) % 1009) as f64 / 504.5 - 1.0);
    let step = of(&|k| f64::from(u8::from(k >= 20)));
    let alternating = of(&|k| if k % 2 == 0 { 1.0 } else { -1.0 });
    let one_present: Vec<bool> = (0..SAMPLES).map(|k| k == 30).collect();
    let times = |x: &[f64], by: f64| x.iter().map(|v| v * by).collect::<Vec<f64>>();
    vec![
        ("both constant", vec![1.0; SAMPLES], vec![2.0; SAMPLES], None),
        ("constant command", vec![1.0; SAMPLES], noise(1), None),
        ("constant response", noise(1), vec![0.0; SAMPLES], None),
        ("two samples", vec![0.0, 1.0], vec![0.0, 1.0], None),
        ("one sample", vec![1.0], vec![1.0], None),
        ("no sample", vec![], vec![], None),
        ("1e308", times(&noise(1), 1e308), times(&noise(2), -1e308), None),
        ("1e-308", times(&noise(1), 1e-308), times(&noise(2), 1e-308), None),
        ("1e308 after 1e-308", times(&noise(1), 1e-308), times(&noise(1), 1e308), None),
        ("alternating", alternating.clone(), times(&alternating, -1.0), None),
        ("all but one missing", noise(1), noise(2), Some(one_present)),
        ("response is the command", noise(1), noise(1), None),
        ("step and step", step.clone(), step.clone(), None),
        ("one impulse at the end", of(&|k| f64::from(u8::from(k == SAMPLES - 1))), noise(1), None),
        ("ramps", of(&|k| k as f64), of(&|k| 3.0 * k as f64), None),
        ("one part in 1e16", of(&|k| 1e16 + 2.0 * (k % 2) as f64), noise(3), None),
        ("-0 and 0", of(&|k| if k % 2 == 0 { 0.0 } else { -0.0 }), noise(1), None),
    ]
}

#[test]
fn no_answer_on_a_degenerate_record_holds_nan() {
    let cases: Vec<(Record, usize)> = records()
        .into_iter()
        .flat_map(|r| (0..METHODS.len()).map(move |m| (r.clone(), m)))
        .collect();
    let answered: usize = cases
        .par_iter()
        .filter(|(_, number)| METHODS[*number].scope != Scope::States)
        .map(|((what, u, y, present), number)| {
            let method = &METHODS[*number];
            let ts = SampleTime::new(0.02).unwrap();
            // A record that is refused when it is built asks no method for an answer.
            let built = match method.scope {
                Scope::Events => Experiment::of_events(
                    ts,
                    ["u", "y"],
                    vec![Events { first: u.clone(), second: y.clone(), ..Events::default() }],
                ),
                _ => {
                    let output =
                        Series { values: y.into(), present: present.as_deref().map(Into::into) };
                    let recording = Recording {
                        inputs: vec![u.into()],
                        outputs: vec![output],
                        states: Vec::new(),
                    };
                    Experiment::new(ts, vec!["u".into()], vec!["y".into()], vec![recording])
                }
            };
            let Ok(experiment) = built else { return 0 };
            let search = Search { max_delay: 10, ..Search::default() };
            let answers = method
                .entry
                .with(json!({}))
                .unwrap()
                .estimate_inputs(&experiment, &search)
                .unwrap_or_default();
            for e in &answers {
                let numbers = [
                    e.delay_s,
                    e.std_s,
                    e.raw_delay_s,
                    e.ci95_s.map(|i| i[0]),
                    e.ci95_s.map(|i| i[1]),
                    Some(e.degree_bias_samples),
                ];
                assert!(
                    !numbers.iter().flatten().any(|v| v.is_nan()),
                    "{} on {what}: {e:?}",
                    method.entry.name
                );
                assert!(
                    e.delay_s.is_none_or(f64::is_finite),
                    "{} on {what}: {e:?}",
                    method.entry.name
                );
            }
            answers.len()
        })
        .sum();
    assert!(answered >= METHODS.len(), "only {answered} of {} records have an answer", cases.len());
}
