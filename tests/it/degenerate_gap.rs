//! Diagnoses of logs and models that are legal and leave little to diagnose: a finite answer, or a refusal in words; never a panic, never NaN.

use deadtime::diagnose::{GapOptions, diagnose};
use deadtime::log::{Channel, Log};
use rayon::prelude::*;

use crate::gap_hard::document;

const SAMPLES: usize = 64;

fn lti(a: &str, b: &str, c: &str, states: usize, inputs: usize) -> String {
    let named = |letter: &str, count: usize| {
        (0..count).map(|i| format!("{{ name = \"{letter}{i}\" }}")).collect::<Vec<_>>().join(", ")
    };
    let d = vec!["0.0"; inputs].join(", ");
    let (states, inputs) = (named("x", states), named("u", inputs));
    format!(
        "format = \"deadtime/model@1\"\nname = \"m\"\nkind = \"lti\"\nA = {a}\nB = {b}\nC = {c}\nD = [[{d}]]\nstates = [{states}]\ninputs = [{inputs}]\n\
         outputs = [{{ name = \"y\" }}]\n"
    )
}

/// What it is, the model, and its inputs.
fn models() -> Vec<(&'static str, String, usize)> {
    let third = "[[-1.0, 1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 0.0, -1.0]]";
    vec![
        ("a lag", lti("[[-2.0]]", "[[2.0]]", "[[1.0]]", 1, 1), 1),
        ("no gain", lti("[[-2.0]]", "[[0.0]]", "[[1.0]]", 1, 1), 1),
        ("nothing to see", lti("[[-2.0]]", "[[2.0]]", "[[0.0]]", 1, 1), 1),
        ("a defective A", lti(third, "[[0.0], [0.0], [1.0]]", "[[1.0, 0.0, 0.0]]", 3, 1), 1),
        (
            "a badly scaled A",
            lti("[[-1e-7, 1e7], [0.0, -50.0]]", "[[0.0], [1e-6]]", "[[1.0, 0.0]]", 2, 1),
            1,
        ),
        ("identical inputs", lti("[[-2.0]]", "[[1.0, 1.0]]", "[[1.0]]", 1, 2), 2),
        ("an integrator", lti("[[0.0]]", "[[1.0]]", "[[1.0]]", 1, 1), 1),
    ]
}

/// Command, response, and which samples of the response are there.
type Record = (&'static str, Vec<f64>, Vec<f64>, Option<Vec<bool>>);

fn records() -> Vec<Record> {
    let of = |f: &dyn Fn(usize) -> f64| (0..SAMPLES).map(f).collect::<Vec<f64>>();
    let noise = |seed: usize| of(&|k| ((k * 7919 + seed * 104_729) % 1009) as f64 / 504.5 - 1.0);
    let times = |x: &[f64], by: f64| x.iter().map(|v| v * by).collect::<Vec<f64>>();
    let alternating = of(&|k| if k % 2 == 0 { 1.0 } else { -1.0 });
    vec![
        ("both constant", vec![1.0; SAMPLES], vec![2.0; SAMPLES], None),
        ("both zero", vec![0.0; SAMPLES], vec![0.0; SAMPLES], None),
        ("constant command", vec![1.0; SAMPLES], noise(1), None),
        ("constant response", noise(1), vec![0.5; SAMPLES], None),
        ("two samples", vec![0.0, 1.0], vec![0.0, 1.0], None),
        ("1e308", times(&noise(1), 1e308), times(&noise(2), -1e308), None),
        ("1e-308", times(&noise(1), 1e-308), times(&noise(2), 1e-308), None),
        ("1e200 after 1e-200", times(&noise(1), 1e-200), times(&noise(1), 1e200), None),
        ("alternating", alternating.clone(), times(&alternating, -1.0), None),
        ("all but one missing", noise(1), noise(2), Some((0..SAMPLES).map(|k| k == 30).collect())),
        (
            "all but three missing",
            noise(1),
            noise(2),
            Some((0..SAMPLES).map(|k| [20, 30, 60].contains(&k)).collect()),
        ),
        ("response is the command", noise(1), noise(1), None),
        ("an impulse at the end", of(&|k| f64::from(u8::from(k == SAMPLES - 1))), noise(1), None),
        ("one part in 1e16", of(&|k| 1e16 + 2.0 * (k % 2) as f64), noise(3), None),
    ]
}

/// A number in a value's debug text that is none.
fn not_finite(text: &str) -> bool {
    text.split(|c: char| !c.is_ascii_alphanumeric()).any(|word| word == "NaN" || word == "inf")
}

#[test]
#[ignore = "nightly: every degenerate log"]
fn no_diagnosis_of_a_degenerate_log_or_model_holds_nan() {
    assert!(not_finite("Some(NaN)") && not_finite("[-inf]") && !not_finite("information"));
    let cases: Vec<(_, Record)> = models()
        .into_iter()
        .flat_map(|m| records().into_iter().map(move |r| (m.clone(), r)))
        .collect();
    let answered: usize = cases
        .par_iter()
        .map(|((model, text, inputs), (what, u, y, present))| {
            let time_s = (0..u.len()).map(|k| 0.1 * k as f64).collect();
            let response = match present {
                Some(present) => Channel::partial("y", None, y.clone(), present.clone()),
                None => Channel::new("y", None, y.clone()),
            };
            let commands = (0..*inputs).map(|i| Channel::new(format!("u{i}"), None, u.clone()));
            let log = Log::new(*what, time_s, commands.chain([response]).collect()).unwrap();
            match diagnose(&document(text), &[log], &[], &GapOptions::default(), &|_| ()) {
                Err(e) => {
                    let said = e.to_string();
                    assert!(said.len() > 10 && !not_finite(&said), "{model}, {what}: {said}");
                    0
                }
                Ok(found) => {
                    let text = format!("{:?}", found.diagnosis);
                    assert!(!not_finite(&text), "{model}, {what}: {text}");
                    // A limit that does nothing is infinite.
                    assert!(
                        found.handed_over.iter().all(|e| e.values.iter().all(|v| !v.is_nan())),
                        "{model}, {what}"
                    );
                    1
                }
            }
        })
        .sum();
    assert!(answered > cases.len() / 3, "only {answered} of {} were answered", cases.len());
}
