use crate::equations::error::EquationError;
use crate::equations::system::{
    Equations, OutputVariable, Parameter, StateVariable, Symbol, Workspace, Wrt,
};
use approx::assert_abs_diff_eq;
use nalgebra::DMatrix;

/// One state `x`, one input `u`, two parameters, and the expression as its derivative.
fn model(text: &str) -> Result<Equations, EquationError> {
    let symbol = |name: &str| Symbol { name: name.to_owned(), unit: None };
    let state = |name: &str, derivative: &str| StateVariable {
        name: name.into(),
        unit: None,
        initial: 0.0,
        initial_std: None,
        derivative: derivative.into(),
    };
    let parameter = |name: &str, value| Parameter { name: name.into(), unit: None, value };
    Equations::new(
        vec![symbol("u")],
        vec![state("x", text), state("speed", "0")],
        vec![parameter("a", 2.0), parameter("viscous", 3.0)],
        vec![OutputVariable { name: "y".into(), unit: None, equation: "x".into() }],
    )
}

fn value_at(text: &str, x: f64) -> f64 {
    let model = model(text).unwrap_or_else(|e| panic!("{e}"));
    let mut dx = [0.0; 2];
    model.derivatives(1.5, &[x, -0.5], &[0.75], &model.nominal(), &mut model.workspace(), &mut dx);
    dx[0]
}

fn value(text: &str) -> f64 {
    value_at(text, 0.5)
}

#[test]
fn operators_bind_as_mathematics_does() {
    for (text, expect) in [
        ("-2^2", -4.0),
        ("2^3^2", 512.0),
        ("2^-1", 0.5),
        ("2^-1*4", 2.0),
        ("-x^2", -0.25),
        ("2*-3", -6.0),
        ("1-2-3", -4.0),
        ("8/4/2", 1.0),
        ("8/4*2", 4.0),
        ("--2", 2.0),
        ("+2", 2.0),
        ("1 - -2", 3.0),
        ("-(1+2)*3", -9.0),
        ("2+3*4^0.5", 8.0),
        ("1e-3", 1e-3),
        (".5", 0.5),
        ("2.", 2.0),
        ("2.e1 + 1E+1", 30.0),
        ("a*viscous", 6.0),
        ("time", 1.5),
        ("x + u + speed", 0.75),
        ("min(a, viscous) + max(a, viscous)", 5.0),
        ("sign(0) + sign(-0.0)", 0.0),
        ("sign(-3)*2", -2.0),
        ("abs(-3)", 3.0),
        ("2^0.5 - sqrt(2)", 0.0),
        ("(a+1)^3", 27.0),
        ("(a+1)^4", 81.0),
        ("(a+1)^-1*3", 1.0),
        ("(((1)))", 1.0),
        ("2−1", 1.0),
        (" 1\n + 2\t", 3.0),
    ] {
        assert_eq!(value(text), expect, "{text}");
    }
    assert_eq!(value("atan2(1, 2) + sin(x)*cos(x) + tan(x) - asin(x) + acos(x)"), {
        1f64.atan2(2.0) + 0.5f64.sin() * 0.5f64.cos() + 0.5f64.tan() - 0.5f64.asin() + 0.5f64.acos()
    });
    assert_eq!(value("sinh(x) + cosh(x) + tanh(x) + exp(x) + log(x) + atan(x)"), {
        0.5f64.sinh() + 0.5f64.cosh() + 0.5f64.tanh() + 0.5f64.exp() + 0.5f64.ln() + 0.5f64.atan()
    });
}

/// The error message.
fn refusal(text: &str) -> String {
    match model(text) {
        Ok(_) => panic!("{text} was accepted"),
        Err(e) => e.to_string(),
    }
}

#[test]
fn a_refusal_points_at_the_place_and_says_what_to_do() {
    for (text, says) in [
        ("", vec!["column 1", "empty"]),
        ("   ", vec!["empty"]),
        (
            "a*visous",
            vec![
                "column 3",
                "`visous` is unknown",
                "`viscous`?",
                "x, speed, u, a, viscous, time",
                "\n  a*visous\n    ^^^^^^",
            ],
        ),
        ("a*Speed", vec!["did you mean `speed`?"]),
        ("zzzzzzz", vec!["`zzzzzzz` is unknown; known names: x"]),
        ("sin", vec!["`sin` is a function", "parentheses"]),
        ("sine(x)", vec!["no function `sine`", "`sin`?", "atan2"]),
        ("x(2)", vec!["column 2", "`(` follows a value", "* /"]),
        ("sin(x, 2)", vec!["`sin` takes 1 argument, 2 given"]),
        ("atan2(x)", vec!["`atan2` takes 2 arguments, 1 given", "^^^^^^^^"]),
        ("sin()", vec!["`sin` takes 1 argument, 0 given"]),
        ("(x + 1", vec!["column 1", "never closed"]),
        ("sin(x", vec!["column 4", "never closed"]),
        ("x + 1)", vec!["column 6", "closes nothing"]),
        (")", vec!["closes nothing"]),
        ("()", vec!["column 2", "`)` stands where"]),
        ("x +", vec!["column 4", "ends where", "\n     ^"]),
        ("x * / 2", vec!["column 5", "`/` stands where"]),
        ("2 x", vec!["column 3", "`x` follows a value", "put + - * /"]),
        ("x**2", vec!["column 2", "written `^`"]),
        ("1,5", vec!["column 2", "decimal number"]),
        ("(1, 2)", vec!["decimal number"]),
        ("max(1, )", vec!["`)` stands where"]),
        ("max(, 1)", vec!["`,` stands where"]),
        ("1e", vec!["`1e` is no number"]),
        ("1.2.3", vec!["`1.2.3` is no number"]),
        ("1e999", vec!["`1e999` is no number"]),
        ("x = 2", vec!["column 3", "no `=`"]),
        ("x % 2", vec!["`%` has no meaning"]),
        ("größe + x", vec!["column 1", "`größe`"]),
        ("x + ü(3)", vec!["column 5", "no function `ü`"]),
    ] {
        let message = refusal(text);
        for part in says {
            assert!(message.contains(part), "{text}: {message}\nlacks {part}");
        }
        assert!(message.starts_with("derivatives.x"), "{message}");
    }
}

#[test]
fn depth_and_length_have_an_end_that_is_no_stack_overflow() {
    let deep = 100_000;
    for text in [
        "(".repeat(deep) + "1" + &")".repeat(deep),
        "-".repeat(deep) + "1",
        "2^".repeat(deep) + "1",
        "sin(".repeat(deep) + "1" + &")".repeat(deep),
        "(-2^".repeat(deep),
    ] {
        let message = refusal(&text);
        assert!(message.contains("split the expression"), "{message}");
        assert!(message.len() < 1000);
    }
    // A long sum is not deeply nested.
    assert_eq!(value(&("1".to_owned() + &"+1".repeat(9_000))), 9_001.0);
    assert_eq!(value(&("(".repeat(90) + "1" + &")".repeat(90))), 1.0);
    assert_eq!(value(&("1*(-2^".repeat(33) + "1" + &")".repeat(33))).abs(), 2_f64.powi(33));
}

#[test]
fn names_mean_one_thing() {
    let state = |name: &str| StateVariable {
        name: name.into(),
        unit: None,
        initial: 0.0,
        initial_std: None,
        derivative: "0".into(),
    };
    let parameter = |name: &str, value: f64| Parameter { name: name.into(), unit: None, value };
    let input = |name: &str| Symbol { name: name.into(), unit: None };
    let fails = |i: &str, s: &str, p: &str| {
        Equations::new(vec![input(i)], vec![state(s)], vec![parameter(p, 1.0)], vec![])
            .unwrap_err()
            .to_string()
    };
    for (i, s, p, says) in [
        ("u", "x", "x", "`x` is a parameter and a state"),
        ("x", "x", "p", "`x` is an input and a state"),
        ("time", "x", "p", "`time` is an input and the time"),
        ("u", "x", "sin", "`sin` is a parameter and a function"),
        ("u 1", "x", "p", "the input `u 1` cannot stand"),
        ("u", "2x", "p", "the state `2x`"),
        ("u", "", "p", "the state ``"),
    ] {
        let message = fails(i, s, p);
        assert!(message.contains(says), "{message}");
    }
    let nan = Equations::new(vec![], vec![], vec![parameter("p", f64::NAN)], vec![]).unwrap_err();
    assert!(nan.to_string().contains("parameters.p.value is NaN"), "{nan}");
    let odd = StateVariable { initial_std: Some(-1.0), ..state("x") };
    assert!(
        Equations::new(vec![], vec![odd], vec![], vec![])
            .unwrap_err()
            .to_string()
            .contains("states.x.initial_std")
    );
}

#[test]
fn nothing_is_calculated_twice_or_at_run_time_that_need_not_be() {
    // (2 + 3)·a and a·viscous change only with a parameter; sin(x)·u is one product for both terms.
    let model = model("(2+3)*a*x + (sin(x)*u)*(a*viscous) + (u*sin(x))^2 + 0*1 + 1*x/1").unwrap();
    // sin, ·u, 5a·x, ·(a·viscous), square, three sums.
    assert_eq!(model.operations().0, 8);
    let at = |p: &[f64], workspace: &mut Workspace| {
        let mut dx = [0.0; 2];
        model.derivatives(0.0, &[0.5, 0.0], &[0.75], p, workspace, &mut dx);
        dx[0]
    };
    let expect = |a: f64, v: f64| {
        5.0 * a * 0.5 + 0.5f64.sin() * 0.75 * (a * v) + (0.75 * 0.5f64.sin()).powi(2) + 0.5
    };
    let mut workspace = model.workspace();
    for (a, v) in [(2.0, 3.0), (2.5, 3.0), (2.5, -1.0), (2.0, 3.0)] {
        assert_abs_diff_eq!(at(&[a, v], &mut workspace), expect(a, v), epsilon = 1e-15);
    }
    // Memory of another model, or none, is resized.
    let other = self::model("x + a").unwrap();
    let mut dx = [0.0; 2];
    other.derivatives(0.0, &[0.5, 0.0], &[0.75], &[2.0, 3.0], &mut workspace, &mut dx);
    assert_eq!(dx, [2.5, 0.0]);
    assert_abs_diff_eq!(at(&[2.0, 3.0], &mut workspace), expect(2.0, 3.0), epsilon = 1e-15);
    assert_abs_diff_eq!(
        at(&[2.0, 3.0], &mut Workspace::default()),
        expect(2.0, 3.0),
        epsilon = 1e-15
    );
}

#[test]
fn jacobians_agree_with_central_differences() {
    for text in [
        "sin(x)*cos(speed) + tan(x*u) - a*x^3 + viscous*x^2.5",
        "asin(x/2) + acos(speed/3) + atan(x*a) + atan2(u + x, speed*a)",
        "sinh(x) + cosh(speed) - tanh(a*x) + exp(-x*viscous) + log(x + a) + sqrt(x*a)",
        "abs(speed)*speed + sign(x)*a + min(x, speed*u) + max(x*a, viscous)",
        "x^u + a^x + (x + a)^(speed + viscous) + u/(1 + x^2) - -x^4 + a^-1 + x^-3 + viscous^0.5",
        "(x - speed*time)/(a - x*viscous)*time^2",
    ] {
        let model = model(text).unwrap();
        let mut workspace = model.workspace();
        let (x, u, p, t) = ([0.7, -0.4], [1.3], [1.7, 0.6], 0.9);
        let all: Vec<f64> = [&[t][..], &x, &u, &p].concat();
        let f = |all: &[f64], workspace: &mut Workspace| {
            let mut dx = [0.0; 2];
            model.derivatives(all[0], &all[1..3], &all[3..4], &all[4..], workspace, &mut dx);
            dx[0]
        };
        let mut exact = [0.0; 6];
        for (wrt, first, count) in
            [(Wrt::States, 1, 2), (Wrt::Inputs, 3, 1), (Wrt::Parameters, 4, 2)]
        {
            let mut jacobian = vec![0.0; 2 * count];
            model.derivatives_jacobian(wrt, t, &x, &u, &p, &mut workspace, &mut jacobian);
            for j in 0..count {
                exact[first + j] = jacobian[2 * j];
                assert_eq!(jacobian[2 * j + 1], 0.0);
            }
        }
        for j in 1..6 {
            let h = 1e-5;
            let (mut up, mut down) = (all.clone(), all.clone());
            up[j] += h;
            down[j] -= h;
            let difference = (f(&up, &mut workspace) - f(&down, &mut workspace)) / (2.0 * h);
            assert!(
                (difference - exact[j]).abs() < 1e-8 * difference.abs().max(1.0),
                "{text} by {j}: {difference} {}",
                exact[j]
            );
        }
    }
}

#[test]
fn a_linearisation_has_the_matrices_of_the_equations() {
    let model = model("a*x + 2*speed - u*viscous").unwrap();
    let about = model.linearise(0.0, &[1.0, 2.0], &[3.0], &model.nominal());
    assert_eq!(about.a, DMatrix::from_row_slice(2, 2, &[2.0, 2.0, 0.0, 0.0]));
    assert_eq!(about.b, DMatrix::from_row_slice(2, 1, &[-3.0, 0.0]));
    assert_eq!(about.c, DMatrix::from_row_slice(1, 2, &[1.0, 0.0]));
    assert_eq!(about.d, DMatrix::from_row_slice(1, 1, &[0.0]));
    assert!(
        model.derivative_depends(0, Wrt::States, 1)
            && model.derivative_depends(0, Wrt::Parameters, 1)
    );
    assert!(!model.derivative_depends(1, Wrt::States, 1));
    assert!(!model.derivative_depends(0, Wrt::Inputs, 7));
}

#[test]
fn what_is_undefined_is_explained() {
    for (text, x, says) in [
        (
            "(u - viscous*speed)/x",
            0.0,
            "derivatives.x: (u - viscous*speed)/x divides by zero at t = 2 s",
        ),
        ("1 + log(x - 1)*2", 0.5, "log(x - 1) takes the logarithm of -0.5"),
        ("sqrt(x)", -4.0, "sqrt(x) takes the square root of -4"),
        ("asin(x)", 1.5, "the arc sine of 1.5"),
        ("x^0.3", -1.0, "raises -1 to the power 0.3"),
        ("x^-2", 0.0, "raises 0 to the power -2"),
        ("exp(x)", 1e3, "exp(x) grows beyond all numbers"),
        ("2*(1/0)", 0.0, "(1/0) divides by zero"),
        ("3*x", f64::NAN, "derivatives.x: x is NaN"),
    ] {
        let model = model(text).unwrap();
        let found = model.explain(2.0, &[x, 0.0], &[1.0], &model.nominal()).unwrap().to_string();
        assert!(found.contains(says), "{text}: {found}");
    }
    // Infinite intermediate values with a finite result.
    let model = model("atan(1/x) + min(1/x, 2)").unwrap();
    assert_eq!(model.explain(0.0, &[0.0, 0.0], &[1.0], &model.nominal()), None);
}

#[test]
fn equations_are_affine_where_states_and_inputs_stand_alone_or_with_factors_of_parameters() {
    for text in [
        "-a*x + u/viscous - sin(a)*speed + 3",
        "a",
        "-(x - u)*sqrt(a)/2",
        "x*a^2 + max(a, viscous)*u",
        "(a + 1)*(x + speed)",
    ] {
        assert!(model(text).unwrap().is_affine(), "{text}");
    }
    for text in [
        "x*u",
        "x^2",
        "a/x",
        "sin(x)",
        "abs(u)",
        "max(x, 0)",
        "sign(speed)",
        "time",
        "time*x",
        "a^u",
        "x*speed/a",
        "sqrt(x*x)",
    ] {
        assert!(!model(text).unwrap().is_affine(), "{text}");
    }
}
