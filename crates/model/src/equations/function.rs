//! The operations of an expression: their names, values and derivatives.

/// One operation on one or two values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Operation {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Negate,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Atan2,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Log,
    Sqrt,
    Abs,
    Sign,
    Min,
    Max,
    /// The sine; the cosine of the same angle, computed together, belongs to the next step.
    SinCos,
    /// b itself, computed by the previous step.
    Found,
}

/// The functions available in expressions.
const FUNCTIONS: [(&str, Operation, usize); 17] = [
    ("sin", Operation::Sin, 1),
    ("cos", Operation::Cos, 1),
    ("tan", Operation::Tan, 1),
    ("asin", Operation::Asin, 1),
    ("acos", Operation::Acos, 1),
    ("atan", Operation::Atan, 1),
    ("atan2", Operation::Atan2, 2),
    ("sinh", Operation::Sinh, 1),
    ("cosh", Operation::Cosh, 1),
    ("tanh", Operation::Tanh, 1),
    ("exp", Operation::Exp, 1),
    ("log", Operation::Log, 1),
    ("sqrt", Operation::Sqrt, 1),
    ("abs", Operation::Abs, 1),
    ("sign", Operation::Sign, 1),
    ("min", Operation::Min, 2),
    ("max", Operation::Max, 2),
];

/// The functions' names.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    FUNCTIONS.iter().map(|f| f.0)
}

/// Name, operation and number of arguments.
pub(super) fn find(name: &str) -> Option<(&'static str, Operation, usize)> {
    FUNCTIONS.iter().find(|f| f.0 == name).copied()
}

impl Operation {
    /// The value; operations on one value ignore `b`.
    #[inline(always)]
    pub(super) fn apply(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power => a.powf(b),
            Self::Negate => -a,
            Self::Sin | Self::SinCos => a.sin(),
            Self::Cos => a.cos(),
            Self::Tan => a.tan(),
            Self::Asin => a.asin(),
            Self::Acos => a.acos(),
            Self::Atan => a.atan(),
            Self::Atan2 => a.atan2(b),
            Self::Sinh => a.sinh(),
            Self::Cosh => a.cosh(),
            Self::Tanh => a.tanh(),
            Self::Exp => a.exp(),
            Self::Log => a.ln(),
            Self::Sqrt => a.sqrt(),
            Self::Abs => a.abs(),
            Self::Sign => sign(a),
            // NaN must propagate, unlike in f64::min.
            Self::Min => {
                if a.is_nan() || a < b {
                    a
                } else {
                    b
                }
            }
            Self::Max => {
                if a.is_nan() || a > b {
                    a
                } else {
                    b
                }
            }
            Self::Found => b,
        }
    }

    /// Derivatives of the value `y` with respect to a and b. At a corner (abs, min, max at equality) the derivative of one side; for sign 0.
    pub(super) fn partials(self, a: f64, b: f64, y: f64) -> (f64, f64) {
        match self {
            Self::Add => (1.0, 1.0),
            Self::Subtract => (1.0, -1.0),
            Self::Multiply => (b, a),
            Self::Divide => (1.0 / b, -y / b),
            Self::Power => {
                let exponent = if a == 0.0 { 0.0 } else { y * a.ln() };
                (if b == 0.0 { 0.0 } else { b * a.powf(b - 1.0) }, exponent)
            }
            Self::Negate => (-1.0, 0.0),
            Self::Sin | Self::SinCos => (a.cos(), 0.0),
            Self::Cos => (-a.sin(), 0.0),
            Self::Tan => (1.0 + y * y, 0.0),
            Self::Asin => (1.0 / ((1.0 - a) * (1.0 + a)).sqrt(), 0.0),
            Self::Acos => (-1.0 / ((1.0 - a) * (1.0 + a)).sqrt(), 0.0),
            Self::Atan => (1.0 / (1.0 + a * a), 0.0),
            Self::Atan2 => {
                let square = a * a + b * b;
                (b / square, -a / square)
            }
            Self::Sinh => (a.cosh(), 0.0),
            Self::Cosh => (a.sinh(), 0.0),
            Self::Tanh => (1.0 - y * y, 0.0),
            Self::Exp => (y, 0.0),
            Self::Log => (1.0 / a, 0.0),
            Self::Sqrt => (0.5 / y, 0.0),
            Self::Abs => (sign(a), 0.0),
            Self::Sign => (0.0, 0.0),
            Self::Min => {
                if a < b {
                    (1.0, 0.0)
                } else {
                    (0.0, 1.0)
                }
            }
            Self::Found => (0.0, 1.0),
            Self::Max => {
                if a > b {
                    (1.0, 0.0)
                } else {
                    (0.0, 1.0)
                }
            }
        }
    }

    /// The operation is commutative.
    pub(super) fn commutes(self) -> bool {
        matches!(self, Self::Add | Self::Multiply)
    }
}

/// −1, 0 or 1, and NaN for NaN.
fn sign(a: f64) -> f64 {
    if a == 0.0 { 0.0 } else { a.signum() }
}
