use super::*;

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
