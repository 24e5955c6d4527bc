//! Nonlinear models: against scipy (golden/equations), against an independent evaluator, and on any text at all.

use std::path::{Path, PathBuf};

use crate::support::compare::{Comparison, responses_apart, tolerance};
use deadtime::effect::{Applied, Chance, find};
use deadtime::model::{
    Equations, EquationsFile, ModelDocument, OutputVariable, Parameter, StateVariable, Symbol,
};
use deadtime::simulate::{Commands, Hold, Plan, Run, System, Tolerance, Wanted};
use proptest::prelude::*;
use serde::Deserialize;

/// A golden case; its model is read as it stands, since the order of its tables counts.
#[derive(Deserialize)]
struct Case {
    id: String,
    model: EquationsFile,
    time_s: Vec<f64>,
    u: Vec<Vec<f64>>,
    x0: Vec<f64>,
    x: Vec<Vec<f64>>,
    y: Vec<Vec<f64>>,
}

#[derive(Deserialize)]
struct Golden {
    cases: Vec<Case>,
}

fn cases() -> Vec<Case> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("golden/equations/reference.json");
    serde_json::from_str::<Golden>(&std::fs::read_to_string(path).unwrap()).unwrap().cases
}

/// Simulates equations on u, samples × inputs.
fn simulate(
    model: &EquationsFile,
    time_s: &[f64],
    u: &nalgebra::DMatrix<f64>,
    x0: &[f64],
    change: impl Fn(&mut Plan),
) -> Run {
    let system = System::new(&ModelDocument::Equations(model.clone()), |_| Ok(0.0)).unwrap();
    let mut plan = Plan::new(&system);
    change(&mut plan);
    let inputs: Vec<Vec<f64>> = u.column_iter().map(|c| c.iter().copied().collect()).collect();
    let time_s: Vec<f64> = time_s.iter().map(|t| t - time_s[0]).collect();
    system.simulate(&plan, Commands { time_s: &time_s, inputs: &inputs }, x0, None).unwrap()
}

fn matrix(rows: &[Vec<f64>]) -> nalgebra::DMatrix<f64> {
    nalgebra::DMatrix::from_fn(rows.len(), rows[0].len(), |i, j| rows[i][j])
}

#[test]
fn nonlinear_plants_agree_with_scipy_on_even_and_uneven_time_stamps() {
    let mut c = Comparison::new("equations/reference.json");
    for case in cases() {
        let (u, x, y) = (matrix(&case.u), matrix(&case.x), matrix(&case.y));
        for (how, rtol, past_samples, allowed) in [
            ("rtol 1e-11", 1e-11, false, tolerance::EQUATIONS),
            ("rtol 1e-6", 1e-6, false, tolerance::EQUATIONS_COARSE),
            ("rtol 1e-6, steps past samples", 1e-6, true, tolerance::EQUATIONS_COARSE),
        ] {
            let tolerance = Tolerance {
                relative: rtol,
                absolute: rtol * 1e-2,
                past_samples,
                ..Tolerance::default()
            };
            let got = simulate(&case.model, &case.time_s, &u, &case.x0, |plan| {
                plan.tolerance = tolerance
            });
            c.check(
                &format!("{how} x (running maximum)"),
                &case.id,
                responses_apart(&got.x, &x),
                allowed,
            );
            c.check(
                &format!("{how} y (running maximum)"),
                &case.id,
                responses_apart(&got.y, &y),
                allowed,
            );
        }
    }
    c.finish();
}

/// What is not wanted is left out, and what is wanted stays what it was.
#[test]
fn a_part_of_the_samples_is_what_the_whole_begins_with() {
    for case in cases() {
        let u = matrix(&case.u);
        let half = u.nrows() / 2;
        for past_samples in [false, true] {
            let run = |wanted: Wanted| {
                simulate(&case.model, &case.time_s, &u, &case.x0, |plan| {
                    plan.tolerance.past_samples = past_samples;
                    plan.outputs.iter_mut().for_each(|output| {
                        output.delay_s = 0.3 * (case.time_s[1] - case.time_s[0])
                    });
                    plan.wanted = wanted;
                })
            };
            let (whole, part) =
                (run(Wanted::default()), run(Wanted { samples: half, states: false }));
            assert_eq!(part.y.shape(), whole.y.shape());
            assert!(part.x.is_empty());
            assert!(part.y.rows(half, u.nrows() - half).iter().all(|v| *v == 0.0));
            assert!(
                part.steps < whole.steps,
                "{}: {} of {} steps",
                case.id,
                part.steps,
                whole.steps
            );
            let apart = (part.y.rows(0, half) - whole.y.rows(0, half)).amax();
            assert!(apart < 1e-6 * whole.y.amax(), "{}: {apart:e}", case.id);
        }
    }
}

const AFFINE: &str = r#"
format = "deadtime/model@1"
name = "servo under a load"
kind = "equations"
inputs = [{ name = "voltage" }, { name = "load" }]
outputs = [{ name = "angle" }, { name = "current" }]
[states]
angle = { initial = 0.0 }
speed = { initial = 0.0 }
current = { initial = 0.0 }
[parameters]
inertia = { value = 0.012 }
constant = { value = 0.12 }
[derivatives]
angle = "speed"
speed = "(constant*current - 0.015*speed - load)/inertia - 0.4*angle + 0.3"
current = "(voltage - 1.1*current - constant*speed)/0.03"
[output_equations]
angle = "57.3*angle - 2 + 0.1*load"
current = "current + 0.5"
"#;

/// Affine equations are stepped by matrices; a product that is nothing has them integrated. Beside them delays, lags, a resonance, a clock, a friction, a parameter
/// that jumps.
#[test]
fn affine_equations_are_what_their_integration_gives() {
    let folder = tempfile::tempdir().unwrap();
    let system = |text: &str| {
        let path = folder.path().join("model.toml");
        std::fs::write(&path, text).unwrap();
        System::new(&ModelDocument::read(&path).unwrap(), |_| Ok(0.0)).unwrap()
    };
    let systems = [system(AFFINE), system(&AFFINE.replace("+ 0.3", "+ 0.3 + 0*speed*speed"))];
    let time_s: Vec<f64> =
        (0..400).map(|k| 0.02 * f64::from(k) + if k % 7 == 3 { 0.004 } else { 0.0 }).collect();
    let wave = |rate: f64, shift: f64| {
        time_s
            .iter()
            .map(|t| (rate * t + shift).sin().signum() * (1.0 + 0.3 * t))
            .collect::<Vec<f64>>()
    };
    let inputs = vec![wave(2.1, 0.3), wave(1.3, 1.0).iter().map(|v| 0.02 * v).collect()];
    type Effects<'a> = &'a [(&'a str, &'a str, &'a [f64])];
    let effects: [(Effects<'_>, bool); 5] = [
        (&[], true),
        (&[("input_delay", "voltage", &[0.033]), ("actuator_lag", "load", &[0.05])], true),
        (
            &[
                ("unmodelled_mode", "voltage->output:angle", &[14.0, 0.1, 3.0]),
                ("clock_skew", "*", &[1.01]),
            ],
            true,
        ),
        (
            &[
                ("parameter_jump", "constant", &[0.12, 3.3, 0.2]),
                ("sensor_lag", "current", &[0.03]),
            ],
            true,
        ),
        (&[("coulomb_friction", "speed", &[1.2])], false),
    ];
    for (effects, exact) in effects {
        let run = |system: &System| {
            let of = |(name, channel, values): &(&str, &str, &[f64])| {
                let mut applied = Applied::nominal(system, find(name).unwrap(), channel).unwrap();
                applied.values.copy_from_slice(values);
                applied
            };
            let mut plan =
                Applied::plan(system, &effects.iter().map(of).collect::<Vec<_>>(), Chance::Mean)
                    .unwrap();
            plan.tolerance = Tolerance { relative: 1e-11, absolute: 1e-13, ..Tolerance::default() };
            system
                .simulate(
                    &plan,
                    Commands { time_s: &time_s, inputs: &inputs },
                    &[0.2, -0.4, 0.1],
                    None,
                )
                .unwrap()
        };
        let [stepped, integrated] = systems.each_ref().map(run);
        assert!(
            (stepped.steps == 0) == exact && integrated.steps >= time_s.len(),
            "{effects:?}: {} steps",
            stepped.steps
        );
        for (stepped, integrated) in [(&stepped.y, &integrated.y), (&stepped.x, &integrated.x)] {
            let apart = (stepped - integrated).amax() / stepped.amax();
            assert!(apart < 1e-8, "{effects:?}: {apart:e}");
        }
    }
}

#[test]
fn a_delayed_input_is_the_input_moved_and_held_at_the_start() {
    let case = cases().into_iter().find(|c| c.id == "servo_even").unwrap();
    let u = matrix(&case.u);
    let run = |time_s: &[f64], u: &nalgebra::DMatrix<f64>, delay: &[f64]| {
        simulate(&case.model, time_s, u, &case.x0, |plan| {
            plan.tolerance = Tolerance { relative: 1e-11, absolute: 1e-13, ..Tolerance::default() };
            plan.inputs.iter_mut().zip(delay).for_each(|(path, delay_s)| path.delay_s = *delay_s);
        })
    };
    // Three samples of delay: the input's rows three later.
    let moved =
        nalgebra::DMatrix::from_fn(u.nrows(), u.ncols(), |k, j| u[(k.saturating_sub(3), j)]);
    let step = case.time_s[1] - case.time_s[0];
    let (whole, expect) = (run(&case.time_s, &u, &[3.0 * step; 2]), run(&case.time_s, &moved, &[]));
    assert!((whole.x - expect.x).amax() < 1e-9);
    assert!((whole.y - expect.y).amax() < 1e-9);
    // Half a sample of delay: on a grid twice as fine, one of its samples.
    let time_s: Vec<f64> = (0..2 * u.nrows() - 1).map(|k| k as f64 * step / 2.0).collect();
    let fine =
        nalgebra::DMatrix::from_fn(time_s.len(), u.ncols(), |k, j| u[(k.saturating_sub(1) / 2, j)]);
    let (half, expect) = (run(&case.time_s, &u, &[0.5 * step; 2]), run(&time_s, &fine, &[]));
    for k in 0..u.nrows() {
        assert!((half.x.row(k) - expect.x.row(2 * k)).amax() < 1e-9, "{k}");
    }
}

#[test]
fn straight_lines_between_samples_are_integrated_as_such() {
    let file = |text: &str| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.toml");
        std::fs::write(&path, text).unwrap();
        EquationsFile::read(&path).unwrap()
    };
    let model = file(
        "format = \"deadtime/model@1\"\nname = \"i\"\nkind = \"equations\"\ninputs = [{ name = \"u\" }]\noutputs = [{ name = \"y\" }]\n\
         [states]\nx = {}\n[derivatives]\nx = \"u\"\n[output_equations]\ny = \"x + time\"\n",
    );
    let u = nalgebra::DMatrix::from_column_slice(3, 1, &[0.0, 2.0, -2.0]);
    // `time` counts from the first stamp.
    let got = simulate(&model, &[10.0, 11.0, 13.0], &u, &[0.5], |plan| plan.hold = Hold::Linear);
    for (got, expect) in got.y.iter().zip([0.5, 1.0 + 1.5, 3.0 + 1.5]) {
        assert!((got - expect).abs() < 1e-9, "{got} {expect}");
    }
}

#[test]
fn the_example_survives_writing_in_both_syntaxes_with_its_order() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/cart_pendulum.toml");
    let document = ModelDocument::read(&path).unwrap();
    let names: Vec<&str> = document.states().map(|s| s.0).collect();
    assert_eq!(names, ["position", "speed", "angle", "rate"]);
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.toml", "a.json"] {
        let path = folder.path().join(name);
        document.write(&path).unwrap();
        assert_eq!(ModelDocument::read(&path).unwrap(), document, "{name}");
    }
    let ModelDocument::Equations(file) = document else { panic!("a linear model") };
    let again = EquationsFile::from_equations(&file.name, &file.equations().unwrap());
    assert_eq!(again.equations().unwrap(), file.equations().unwrap());
}

/// An expression as a tree, which prints and evaluates itself.
#[derive(Debug, Clone)]
enum Tree {
    Number(f64),
    Name(usize),
    Negate(Box<Tree>),
    Binary(char, Box<Tree>, Box<Tree>),
    Call(&'static str, Vec<Tree>),
}

const NAMES: [&str; 6] = ["x", "v", "u", "p", "q_1", "time"];

impl Tree {
    /// How tightly the outermost operator binds.
    fn strength(&self) -> u8 {
        match self {
            Self::Binary('+' | '-', ..) => 1,
            Self::Binary('*' | '/', ..) => 3,
            Self::Negate(_) => 5,
            Self::Binary(..) => 7,
            _ => 9,
        }
    }

    /// With no more parentheses than needed (after an operator a sign stands in parentheses only where it could be misread).
    fn print(&self, least: u8) -> String {
        let text = match self {
            Self::Number(v) => format!("{v:?}"),
            Self::Name(i) => NAMES[*i].to_owned(),
            Self::Negate(a) => format!("-{}", a.print(5)),
            Self::Binary('^', a, b) => format!("{}^{}", a.print(8), b.print(7)),
            Self::Binary(op, a, b) => {
                format!("{} {op}{}", a.print(self.strength()), b.print(self.strength() + 1))
            }
            Self::Call(f, arguments) => format!(
                "{f}({})",
                arguments.iter().map(|a| a.print(0)).collect::<Vec<_>>().join(" ,")
            ),
        };
        if self.strength() < least { format!("( {text})") } else { text }
    }

    /// A sine of a number so large that its rounding turns it by more than the comparison allows. The power 0.5 of −0 and −∞: 0 and ∞ by a rule of their own, −0 and
    /// no number as a square root. Division by 0, and the angle of a height of 0: they depend on the sign of 0, of which Rust's `min` and sums with 0 make either.
    fn is_ill_conditioned(&self, at: &[f64; 6]) -> bool {
        match self {
            Self::Number(_) | Self::Name(_) => false,
            Self::Negate(a) => a.is_ill_conditioned(at),
            Self::Binary(op, a, b) => {
                let (left, right) = (a.value(at), b.value(at));
                let root = *op == '^' && right == 0.5 && (left == 0.0 || left == f64::NEG_INFINITY);
                root || *op == '/' && right == 0.0
                    || a.is_ill_conditioned(at)
                    || b.is_ill_conditioned(at)
            }
            Self::Call(f, arguments) => {
                let first = arguments[0].value(at);
                arguments.iter().any(|a| a.is_ill_conditioned(at))
                    || matches!(*f, "sin" | "cos") && first.abs() > 1e5
                    || *f == "atan2" && first == 0.0
            }
        }
    }

    fn value(&self, at: &[f64; 6]) -> f64 {
        match self {
            Self::Number(v) => *v,
            Self::Name(i) => at[*i],
            Self::Negate(a) => -a.value(at),
            Self::Binary(op, a, b) => {
                let (a, b) = (a.value(at), b.value(at));
                match op {
                    '+' => a + b,
                    '-' => a - b,
                    '*' => a * b,
                    '/' => a / b,
                    _ => a.powf(b),
                }
            }
            Self::Call(f, arguments) => {
                let a = arguments[0].value(at);
                let b = arguments.get(1).map_or(0.0, |b| b.value(at));
                match *f {
                    "sin" => a.sin(),
                    "cos" => a.cos(),
                    "tanh" => a.tanh(),
                    "atan" => a.atan(),
                    "exp" => a.exp(),
                    "log" => a.ln(),
                    "sqrt" => a.sqrt(),
                    "abs" => a.abs(),
                    "sign" if a.is_nan() => a,
                    "sign" => f64::from(i8::from(a > 0.0) - i8::from(a < 0.0)),
                    "atan2" => a.atan2(b),
                    // NaN must not get lost.
                    _ if a.is_nan() || b.is_nan() => f64::NAN,
                    "min" => a.min(b),
                    _ => a.max(b),
                }
            }
        }
    }
}

fn trees() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        prop_oneof![
            Just(0.0),
            Just(1.0),
            Just(2.0),
            Just(3.0),
            Just(4.0),
            Just(0.5),
            0.0..1e3,
            1e-9..1e-3
        ]
        .prop_map(Tree::Number),
        (0..NAMES.len()).prop_map(Tree::Name),
    ];
    leaf.prop_recursive(6, 40, 2, |inner| {
        let one = prop::sample::select(vec![
            "sin", "cos", "tanh", "atan", "exp", "log", "sqrt", "abs", "sign",
        ]);
        let two = prop::sample::select(vec!["atan2", "min", "max"]);
        prop_oneof![
            1 => inner.clone().prop_map(|a| Tree::Negate(Box::new(a))),
            4 => (prop::sample::select(vec!['+', '-', '*', '/', '^']), inner.clone(), inner.clone())
                .prop_map(|(op, a, b)| Tree::Binary(op, Box::new(a), Box::new(b))),
            1 => (one, inner.clone()).prop_map(|(f, a)| Tree::Call(f, vec![a])),
            1 => (two, inner.clone(), inner).prop_map(|(f, a, b)| Tree::Call(f, vec![a, b])),
        ]
    })
}

/// States x and v, input u, parameters p and q_1.
fn compile(derivative: &str, output: &str) -> Result<Equations, deadtime::model::EquationError> {
    let state = |name: &str, derivative: &str| StateVariable {
        name: name.into(),
        unit: None,
        initial: 0.0,
        initial_std: None,
        derivative: derivative.into(),
    };
    let parameter = |name: &str| Parameter { name: name.into(), unit: None, value: 1.0 };
    Equations::new(
        vec![Symbol { name: "u".into(), unit: None }],
        vec![state("x", derivative), state("v", output)],
        vec![parameter("p"), parameter("q_1")],
        vec![OutputVariable { name: "y".into(), unit: None, equation: output.into() }],
    )
}

/// The same to rounding; powers are multiplied out.
fn alike(a: f64, b: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan()) || (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn printed_expressions_evaluate_as_an_independent_evaluator_does(first in trees(), second in trees(), at in prop::array::uniform6(-3.0..3.0_f64)) {
        let (texts, t) = ((first.print(0), second.print(0)), at[5]);
        let model = compile(&texts.0, &texts.1).map_err(|e| TestCaseError::fail(format!("{texts:?}: {e}")))?;
        let (mut workspace, mut dx, mut y) = (model.workspace(), [0.0; 2], [0.0]);
        model.derivatives(t, &at[..2], &at[2..3], &at[3..5], &mut workspace, &mut dx);
        model.outputs(t, &at[..2], &at[2..3], &at[3..5], &mut workspace, &mut y);
        let expect = (first.value(&at), second.value(&at));
        // Rounding before a function with a jump or a domain's edge may tip a value; the tree's own value nearby then shows the jump.
        let nearby = |tree: &Tree, got: f64| {
            let wobbled = (0..12).any(|i| {
                let moved: Vec<f64> = at.iter().enumerate().map(|(j, v)| v * (1.0 + 1e-13 * f64::from(((i * 7 + j as i32 * 5) % 12) - 6))).collect();
                let value = tree.value(&moved.try_into().unwrap());
                alike(value, got) || !value.is_finite()
            });
            alike(tree.value(&at), got) || wobbled || tree.is_ill_conditioned(&at) || !tree.value(&at).is_finite() && !got.is_finite()
        };
        prop_assert!(nearby(&first, dx[0]), "{}: {} instead of {}", texts.0, dx[0], expect.0);
        prop_assert!(nearby(&second, dx[1]), "{}: {} instead of {}", texts.1, dx[1], expect.1);
        prop_assert!(dx[1].to_bits() == y[0].to_bits());
        // An explanation exactly where something is not finite.
        let finite = dx[0].is_finite() && dx[1].is_finite();
        // What is not finite within may be so no more without: tanh(1/0) is 1.
        let hidden = [&first, &second].iter().any(|tree| tree.is_ill_conditioned(&at)) || texts.0.contains('^') || texts.1.contains('^');
        prop_assert!(model.explain(t, &at[..2], &at[2..3], &at[3..5]).is_none() || !finite || hidden);
    }

    /// Blanks of every alphabet too: nothing but them is an empty expression.
    #[test]
    fn blanks_of_any_kind_are_an_empty_expression(text in "\\s{0,5}") {
        let message = compile(&text, "x").unwrap_err().to_string();
        prop_assert!(message.contains("empty"), "{message}");
    }

    #[test]
    fn no_text_stops_the_parser(text in any::<String>()) {
        let _ = compile(&text, "x").map_err(|e| e.to_string());
    }

    #[test]
    fn no_text_of_the_right_letters_stops_the_parser(text in "[-+*/^(),.0-9e xuvp_1sin()tame²\\\\−]{0,60}") {
        if let Err(e) = compile(&text, "x") {
            let message = e.to_string();
            prop_assert!(message.contains("derivatives.x, column "), "{message}");
            prop_assert!(message.ends_with('^'), "{message}");
        }
    }
}
