//! Held-out data are reported and select nothing.

use deadtime::diagnose::Diagnosis;
use serde_json::Value;

use super::gap_hard::{as_log, diagnosed, document, log, servo};

/// What training decides: the gap and the causes without their held-out shares and errors.
fn decided(d: &Diagnosis) -> Value {
    fn strip(value: &mut Value) {
        match value {
            Value::Object(map) => {
                for name in ["without_it", "description", "order", "next_experiment"] {
                    map.remove(name);
                }
                if let Some(share) = map.get_mut("share").and_then(Value::as_object_mut) {
                    share.retain(|name, _| name == "learnt");
                }
                map.values_mut().for_each(strip);
            }
            Value::Array(all) => all.iter_mut().for_each(strip),
            _ => {}
        }
    }
    let mut cause = serde_json::to_value((&d.gap, &d.cause)).unwrap();
    strip(&mut cause);
    cause
}

#[test]
fn the_same_training_logs_have_the_same_causes_whatever_is_held_out() {
    let model = document(&servo(", initial_std = 0.02", ""));
    let truth: [(&str, &str, &[f64]); 2] =
        [("input_gain", "u", &[1.3]), ("output_delay", "rate", &[0.06])];
    let machine = |effects: &[(&str, &str, &[f64])], samples: usize, seed: u64| {
        log(&model, effects, samples, seed, &[0.0, 0.0])
    };
    let training = [machine(&truth, 400, 1), machine(&truth, 400, 2)];
    let same = machine(&truth, 400, 3);
    let another = machine(&[("input_gain", "u", &[-2.0])], 400, 4);
    let short = machine(&truth, 80, 5);
    let time_s: Vec<f64> = same.time_s().iter().map(|t| 1.7 * t).collect();
    let u = same.input("u").unwrap().to_vec();
    let outputs = ["angle", "rate"].map(|name| {
        let output = same.output(name).unwrap();
        (0..same.len()).map(|k| output.get(k).unwrap()).collect()
    });
    let slower = as_log("slower.csv", time_s, &u, &outputs);
    let first = decided(&diagnosed(&model, &training, std::slice::from_ref(&same)));
    assert!(first.to_string().contains("input_gain"), "{first}");
    // Another machine's, one shorter than the others and one slower.
    assert_eq!(decided(&diagnosed(&model, &training, &[another, short, slower])), first);
}

/// The last part of a log that is held out of it is read by nothing that selects either.
#[test]
fn what_happens_in_the_held_out_part_of_a_log_changes_no_cause() {
    let model = document(&servo(", initial_std = 0.02", ""));
    let truth: [(&str, &str, &[f64]); 1] = [("coulomb_friction", "v", &[0.6])];
    let whole = log(&model, &truth, 900, 6, &[0.0, 0.0]);
    let until = 640; // training is the first 70 %
    let spoilt: Vec<Vec<f64>> = ["angle", "rate"]
        .iter()
        .map(|name| {
            let output = whole.output(name).unwrap();
            let value = |k: usize| output.get(k).unwrap() * if k < until { 1.0 } else { -3.0 };
            (0..whole.len()).map(value).collect()
        })
        .collect();
    let u = whole.input("u").unwrap().to_vec();
    let spoilt = as_log(whole.source(), whole.time_s().to_vec(), &u, &spoilt);
    let [before, after] = [whole, spoilt].map(|log| decided(&diagnosed(&model, &[log], &[])));
    assert_eq!(before, after);
}
