//! Fresh random models on every run, answered by this crate and by scipy and python-control (scripts/differential_reference.py).
//!
//! DEADTIME_SEED repeats a run. DEADTIME_PYTHON names another interpreter than `.venv/bin/python`. Without one the test is skipped, or fails if CI or
//! DEADTIME_REQUIRE_REFERENCE is set.

use crate::support::compare;
use std::path::PathBuf;
use std::process::Command;

use crate::support::compare::{
    Comparison, apart, complex_list, matrix, number, responses_apart, sets_apart, text, to_json,
    vector,
};
use crate::support::outside::reference_python;
use deadtime::model::c2d::{
    Conversion, Feedthrough, FirstOrderHold, ImpulseInvariant, Tustin, ZeroOrderHold,
};
use deadtime::model::{StateSpace, dlqr};
use deadtime::simulate::{Hold, Options, Prehistory, lsim};
use deadtime::time::SampleTime;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

/// Problems compared of each kind.
const WANTED: usize = 60;
/// Problems sent at a time of each kind.
const BATCH: usize = 70;
/// Batches after which too few good problems are a failure.
const ROUNDS: usize = 5;
/// Accepted disagreement per unit of condition number.
const PER_CONDITION: f64 = 1e-10;
/// A problem whose tolerance would exceed this is redrawn.
const CAP: f64 = 1e-6;

const KINDS: [&str; 9] = [
    "c2d zoh",
    "c2d foh",
    "c2d tustin",
    "c2d impulse",
    "dlqr",
    "dlqr with N",
    "lsim zoh",
    "lsim linear",
    "zeros_poles",
];

fn seed() -> u64 {
    match std::env::var("DEADTIME_SEED") {
        Ok(text) => text.parse().expect("DEADTIME_SEED is a whole number"),
        // The thread's generator is seeded by the operating system.
        Err(_) => rand::random(),
    }
}

#[test]
fn random_problems_agree_with_scipy_and_python_control() {
    let Some(python) = reference_python("scipy, control") else { return };
    let seed = seed();
    println!("seed {seed} (DEADTIME_SEED={seed} repeats this run)");
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut c = Comparison::new("differential");
    let mut compared = [0; KINDS.len()];
    let (mut failed, mut conditioned) = ([0; KINDS.len()], [0; KINDS.len()]);
    for _ in 0..ROUNDS {
        let mut problems = Vec::new();
        for (which, kind) in KINDS.iter().enumerate().filter(|&(which, _)| compared[which] < WANTED)
        {
            problems.extend((0..BATCH).map(|_| (which, draw(kind, &mut rng))));
        }
        if problems.is_empty() {
            break;
        }
        let answers = ask(&python, &problems);
        for (number, ((which, problem), answer)) in problems.iter().zip(&answers).enumerate() {
            if compared[*which] >= WANTED {
                continue;
            }
            if !answer["error"].is_null() {
                failed[*which] += 1;
                continue;
            }
            let tolerance = PER_CONDITION * compare::number(answer, "condition");
            if tolerance > CAP {
                conditioned[*which] += 1;
                continue;
            }
            compared[*which] += 1;
            let kind = KINDS[*which];
            let case = format!(
                "{kind} number {number}, condition {:.1e}",
                compare::number(answer, "condition")
            );
            match disagreement(problem, answer) {
                Ok(apart) => {
                    c.check(kind, &case, apart, tolerance);
                    c.check(
                        &format!("{kind}, per condition number"),
                        &case,
                        apart * PER_CONDITION / tolerance,
                        PER_CONDITION,
                    );
                }
                Err(why) => c.fail(format!("seed {seed}, {case}: {why}: {problem}")),
            }
        }
    }
    for (which, kind) in KINDS.iter().enumerate() {
        let (failed, conditioned) = (failed[which], conditioned[which]);
        println!(
            "{kind}: {} compared; redrawn: {failed} the reference failed on, {conditioned} ill conditioned",
            compared[which]
        );
        if compared[which] < WANTED {
            c.fail(format!(
                "{kind}: only {} problems of {WANTED} could be compared",
                compared[which]
            ));
        }
    }
    c.finish();
}

fn ask(python: &PathBuf, problems: &[(usize, Value)]) -> Vec<Value> {
    let folder = tempfile::tempdir().unwrap();
    let (question, reply) =
        (folder.path().join("problems.json"), folder.path().join("answers.json"));
    let list: Vec<&Value> = problems.iter().map(|(_, problem)| problem).collect();
    std::fs::write(&question, serde_json::to_string(&list).unwrap()).unwrap();
    let script =
        PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scripts/differential_reference.py");
    let output = Command::new(python).arg(script).arg(&question).arg(&reply).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answers: Value = serde_json::from_str(&std::fs::read_to_string(&reply).unwrap()).unwrap();
    let answers = answers["answers"].as_array().unwrap().clone();
    assert_eq!(answers.len(), problems.len());
    answers
}

fn normal(rng: &mut ChaCha8Rng, rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| rng.sample(rand_distr::StandardNormal))
}

/// Entries of A, B, C, D as the reference wants them.
fn model(rng: &mut ChaCha8Rng, order: usize, inputs: usize, outputs: usize) -> Value {
    let spread = rng.random_range(0.3..3.0) / (order as f64).sqrt();
    let a = normal(rng, order, order) * spread
        - DMatrix::from_diagonal_element(order, order, rng.random_range(0.0..2.0));
    let [b, c, d] =
        [(order, inputs), (outputs, order), (outputs, inputs)].map(|(i, j)| normal(rng, i, j));
    json!({"A": to_json(&a), "B": to_json(&b), "C": to_json(&c), "D": to_json(&d)})
}

fn draw(kind: &str, rng: &mut ChaCha8Rng) -> Value {
    let (order, inputs, outputs) =
        (rng.random_range(1..=8), rng.random_range(1..=3), rng.random_range(1..=3));
    let sample_time_s = 10f64.powf(rng.random_range(-2.0..0.0));
    let mut problem = match kind.split_once(' ') {
        Some(("c2d", method)) => {
            let mut problem = model(rng, order, inputs, outputs);
            problem["method"] = json!(method);
            if method == "impulse" {
                problem["D"] = to_json(&DMatrix::zeros(outputs, inputs));
            }
            problem
        }
        Some(("lsim", hold)) => {
            let mut problem = model(rng, order, inputs, outputs);
            problem["hold"] = json!(hold);
            problem["x0"] = json!(normal(rng, order, 1).as_slice());
            problem["u"] = to_json(&normal(rng, 60, inputs));
            problem
        }
        _ if kind == "zeros_poles" => model(rng, order, inputs, inputs),
        _ => regulator(kind == "dlqr with N", rng),
    };
    problem["kind"] = json!(kind.split(' ').next());
    problem["sample_time_s"] = json!(sample_time_s);
    problem
}

/// [[Q, N], [N', R]] = F'F + a little, orders 1 to 12, spectral radius 0.3 to 1.4.
fn regulator(cross: bool, rng: &mut ChaCha8Rng) -> Value {
    let (order, inputs) = (rng.random_range(1..=12_usize), rng.random_range(1..=3_usize));
    let a = normal(rng, order, order);
    let radius = a.complex_eigenvalues().iter().map(|p| p.norm()).fold(1e-3, f64::max);
    let a = a * (rng.random_range(0.3..1.4) / radius);
    let size = order + inputs;
    let factor = normal(rng, size, size);
    let weight =
        factor.tr_mul(&factor) / size as f64 + DMatrix::from_diagonal_element(size, size, 0.05);
    let part = |i, j, rows, columns| to_json(&weight.view((i, j), (rows, columns)).into_owned());
    json!({
        "A": to_json(&a), "B": to_json(&normal(rng, order, inputs)),
        "Q": part(0, 0, order, order), "R": part(order, order, inputs, inputs),
        "N": if cross { part(0, order, order, inputs) } else { Value::Null },
    })
}

/// How far our answer is from the reference's.
fn disagreement(problem: &Value, answer: &Value) -> Result<f64, String> {
    let ts = SampleTime::new(number(problem, "sample_time_s")).unwrap();
    let given = |key: &str| matrix(&problem[key]);
    let of = |key: &str| matrix(&answer[key]);
    if problem["kind"] == "dlqr" {
        let n = (!problem["N"].is_null()).then(|| given("N"));
        let ours = dlqr(&given("A"), &given("B"), &given("Q"), &given("R"), n.as_ref())
            .map_err(|e| e.to_string())?;
        return Ok(apart(&ours.k, &of("K")).max(apart(&ours.x, &of("X"))));
    }
    let sys = StateSpace::continuous(given("A"), given("B"), given("C"), given("D"))
        .map_err(|e| e.to_string())?;
    match text(problem, "kind") {
        "c2d" => {
            let conversion: &dyn Conversion = match text(problem, "method") {
                "zoh" => &ZeroOrderHold {},
                "foh" => &FirstOrderHold {},
                "tustin" => &Tustin { prewarp_rad_s: None, fractional_delay_order: 0 },
                _ => &ImpulseInvariant { feedthrough: Feedthrough::Keep },
            };
            let ours = conversion.c2d(&sys, ts).map_err(|e| e.to_string())?;
            let all = [("A", ours.a()), ("B", ours.b()), ("C", ours.c()), ("D", ours.d())];
            Ok(all.into_iter().map(|(key, got)| apart(got, &of(key))).fold(0.0, f64::max))
        }
        "lsim" => {
            let hold = if text(problem, "hold") == "linear" { Hold::Linear } else { Hold::Zero };
            let initial: DVector<f64> = vector(&problem["x0"]);
            let options = Options { initial: Some(initial), hold, prehistory: Prehistory::Held };
            let ours = lsim(&sys, &given("u"), ts, &options).map_err(|e| e.to_string())?;
            Ok(responses_apart(&ours.y, &of("y")))
        }
        _ => {
            let zeros = sets_apart(&sys.zeros(), &complex_list(&answer["zeros"]));
            Ok(zeros.max(sets_apart(&sys.poles(), &complex_list(&answer["poles"]))))
        }
    }
}
