//! What the golden and differential tests share: tolerances, JSON as matrices, and how far two answers are apart.

use std::collections::BTreeMap;
use std::path::PathBuf;

use nalgebra::{Complex, DMatrix, DVector};
use serde_json::Value;

/// Largest relative disagreements that are accepted. A file's own tolerance holds where it is tighter; its SOURCE.md says why.
pub(crate) mod tolerance {
    /// Of whatever a reference tool computes in double precision, unless a name below says more.
    pub(crate) const RELATIVE: f64 = 1e-10;
    /// Of the denominator of an output-error fit, the argument of a minimum (golden/regression/SOURCE.md).
    pub(crate) const OE_DENOMINATOR: f64 = 1e-8;
    /// Of nonlinear simulations at rtol 1e-11, beside scipy at the same (golden/equations/SOURCE.md).
    pub(crate) const EQUATIONS: f64 = 1e-9;
    /// Of nonlinear simulations at rtol 1e-6.
    pub(crate) const EQUATIONS_COARSE: f64 = 1e-3;
    /// Of its initial state (golden/regression/SOURCE.md).
    pub(crate) const OE_INITIAL: f64 = 1e-7;
    /// By how much the loss of a fit that explains next to nothing (above 0.8 of the output's power) may exceed the smallest known: the narrow resonances at
    /// the edge of stability that fit noise best there are many, and the scan does not look for them all (golden/regression/SOURCE.md).
    pub(crate) const OE_LOSS_BOUND: f64 = 5e-2;
}

/// The parsed golden file, `golden/<case>/<file>`.
pub(crate) fn golden(case: &str, file: &str) -> Value {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("golden").join(case).join(file);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

pub(crate) fn cases(file: &Value) -> &[Value] {
    file["cases"].as_array().unwrap()
}

pub(crate) fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_else(|| panic!("{key} is no text: {}", value[key]))
}

pub(crate) fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} is no number: {}", value[key]))
}

pub(crate) fn count(value: &Value, key: &str) -> usize {
    usize::try_from(value[key].as_u64().unwrap()).unwrap()
}

pub(crate) fn list(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

pub(crate) fn matrix(value: &Value) -> DMatrix<f64> {
    let rows: Vec<Vec<f64>> = value.as_array().unwrap().iter().map(list).collect();
    let columns = rows.first().map_or(0, Vec::len);
    DMatrix::from_fn(rows.len(), columns, |i, j| rows[i][j])
}

pub(crate) fn vector(value: &Value) -> DVector<f64> {
    DVector::from_vec(list(value))
}

pub(crate) fn complex_list(value: &Value) -> Vec<Complex<f64>> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|v| Complex::new(v[0].as_f64().unwrap(), v[1].as_f64().unwrap()))
        .collect()
}

/// A matrix as nested JSON arrays, row by row.
pub(crate) fn to_json(m: &DMatrix<f64>) -> Value {
    Value::from(
        m.row_iter()
            .map(|row| Value::from(row.iter().copied().collect::<Vec<f64>>()))
            .collect::<Vec<_>>(),
    )
}

/// Largest difference over the largest magnitude of the expected matrix; infinite for another shape.
pub(crate) fn apart(got: &DMatrix<f64>, expected: &DMatrix<f64>) -> f64 {
    if got.shape() != expected.shape() {
        return f64::INFINITY;
    }
    relative(largest((got - expected).iter().copied()), largest(expected.iter().copied()))
}

/// As [`apart`], for a list.
pub(crate) fn list_apart(got: &[f64], expected: &[f64]) -> f64 {
    if got.len() != expected.len() {
        return f64::INFINITY;
    }
    relative(
        largest(got.iter().zip(expected).map(|(g, e)| g - e)),
        largest(expected.iter().copied()),
    )
}

/// Largest difference of responses (samples × channels), each over the largest magnitude of its channel up to that sample.
///
/// Before the first sample that is not 0 the scale is the size of that one.
pub(crate) fn responses_apart(got: &DMatrix<f64>, expected: &DMatrix<f64>) -> f64 {
    if got.shape() != expected.shape() {
        return f64::INFINITY;
    }
    let mut worst = 0.0;
    for (g, e) in got.column_iter().zip(expected.column_iter()) {
        let mut scale = e.iter().copied().find(|v| *v != 0.0).map_or(0.0, f64::abs);
        for (g, e) in g.iter().zip(e.iter()) {
            scale = scale.max(e.abs());
            worst = larger(worst, relative((g - e).abs(), scale));
        }
    }
    worst
}

/// As [`responses_apart`], over the largest magnitude of all channels up to the sample.
pub(crate) fn responses_apart_together(got: &DMatrix<f64>, expected: &DMatrix<f64>) -> f64 {
    if got.shape() != expected.shape() {
        return f64::INFINITY;
    }
    let (mut worst, mut scale) = (0.0, 0.0);
    for (g, e) in got.row_iter().zip(expected.row_iter()) {
        scale = larger(scale, e.amax());
        worst = larger(worst, relative((g - e).amax(), scale));
    }
    worst
}

/// Largest relative difference of frequency responses, point by point.
pub(crate) fn points_apart(got: &[Complex<f64>], expected: &[Complex<f64>]) -> f64 {
    if got.len() != expected.len() {
        return f64::INFINITY;
    }
    got.iter().zip(expected).map(|(g, e)| relative((g - e).norm(), e.norm())).fold(0.0, larger)
}

/// Largest distance between two sets of complex numbers, paired nearest first, over the largest magnitude.
pub(crate) fn sets_apart(got: &[Complex<f64>], expected: &[Complex<f64>]) -> f64 {
    if got.len() != expected.len() {
        return f64::INFINITY;
    }
    let (mut left, mut right) = (got.to_vec(), expected.to_vec());
    let mut worst = 0.0;
    while !left.is_empty() {
        let pairs = (0..left.len()).flat_map(|i| (0..right.len()).map(move |j| (i, j)));
        let distance = |&(i, j): &(usize, usize)| (left[i] - right[j]).norm();
        let (i, j) = pairs.min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
        worst = larger(worst, distance(&(i, j)));
        left.swap_remove(i);
        right.swap_remove(j);
    }
    relative(worst, largest(expected.iter().map(|v| v.norm())))
}

/// A difference over a scale; where the scale is 0 only no difference will do.
pub(crate) fn relative(difference: f64, scale: f64) -> f64 {
    if difference == 0.0 { 0.0 } else { difference.abs() / scale }
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.map(f64::abs).fold(0.0, larger)
}

/// The larger of two, and NaN if either is.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

struct Field {
    worst: f64,
    at: String,
    tolerance: f64,
    compared: usize,
}

/// The worst disagreement of every field of one file.
pub(crate) struct Comparison {
    name: String,
    fields: BTreeMap<String, Field>,
    failures: Vec<String>,
}

impl Comparison {
    pub(crate) fn new(name: &str) -> Self {
        Self { name: name.into(), fields: BTreeMap::new(), failures: Vec::new() }
    }

    pub(crate) fn check(&mut self, field: &str, case: &str, disagreement: f64, tolerance: f64) {
        let entry = self.fields.entry(field.into()).or_insert(Field {
            worst: 0.0,
            at: String::new(),
            tolerance,
            compared: 0,
        });
        entry.compared += 1;
        entry.tolerance = entry.tolerance.max(tolerance);
        if disagreement.is_nan() || disagreement > entry.worst {
            entry.worst = disagreement;
            entry.at = case.into();
        }
        if disagreement.is_nan() || disagreement > tolerance {
            self.failures.push(format!(
                "{case}: {field} differs by {disagreement:.2e}, more than {tolerance:.0e}"
            ));
        }
    }

    pub(crate) fn fail(&mut self, what: String) {
        self.failures.push(what);
    }

    /// Prints the worst disagreement of every field and fails if one was too large.
    pub(crate) fn finish(self) {
        for (field, f) in &self.fields {
            let at = if f.at.is_empty() { String::new() } else { format!(" at {}", f.at) };
            println!(
                "{}: {field}: worst {:.1e}{at} ({} compared, tolerance {:.0e})",
                self.name, f.worst, f.compared, f.tolerance
            );
        }
        assert!(!self.fields.is_empty(), "{}: nothing was compared", self.name);
        assert!(self.failures.is_empty(), "{}:\n  {}", self.name, self.failures.join("\n  "));
    }
}
