//! Functions of states and commands that a missing force may follow: products of two and three, waves over an angle.

/// With more variables than this, products are left out.
const VARIABLES: usize = 8;

/// Waves a turn of an angle: magnets and slots of small motors.
const WAVES: u8 = 12;

/// A function of one or two variables, by their places among states and then inputs; plainer ones first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Form {
    Plain(usize),
    Sign(usize),
    Drag(usize),
    Square(usize),
    Product(usize, usize),
    /// The first one squared, times the second.
    Bend(usize, usize),
    /// sin(n·v), n a whole number.
    Sine(usize, u8),
    /// cos(n·v).
    Cosine(usize, u8),
}

impl Form {
    pub(crate) fn of(self, value: impl Fn(usize) -> f64) -> f64 {
        match self {
            Self::Plain(v) => value(v),
            Self::Sign(v) => f64::from(i8::from(value(v) > 0.0) - i8::from(value(v) < 0.0)),
            Self::Drag(v) => value(v) * value(v).abs(),
            Self::Square(v) => value(v).powi(2),
            Self::Product(v, w) => value(v) * value(w),
            Self::Bend(v, w) => value(v).powi(2) * value(w),
            Self::Sine(v, n) => (f64::from(n) * value(v)).sin(),
            Self::Cosine(v, n) => (f64::from(n) * value(v)).cos(),
        }
    }

    /// The argument of the form: a variable, or a product of two.
    pub(crate) fn argument(self, value: impl Fn(usize) -> f64) -> f64 {
        match self {
            Self::Product(v, w) => value(v) * value(w),
            Self::Bend(v, w) => value(v).powi(2) * value(w),
            Self::Plain(v) | Self::Sign(v) | Self::Drag(v) | Self::Square(v) => value(v),
            Self::Sine(v, _) | Self::Cosine(v, _) => value(v),
        }
    }

    /// Its value over the argument.
    pub(crate) fn law(self, argument: f64) -> f64 {
        match self {
            Self::Product(..) | Self::Bend(..) => argument,
            of_one => of_one.of(|_| argument),
        }
    }

    /// The argument as an expression of the model file.
    pub(crate) fn over(self, name: impl Fn(usize) -> String) -> String {
        match self {
            Self::Product(v, w) => format!("{}*{}", name(v), name(w)),
            Self::Bend(v, w) => format!("{}^2*{}", name(v), name(w)),
            Self::Plain(v) | Self::Sign(v) | Self::Drag(v) | Self::Square(v) => name(v),
            Self::Sine(v, _) | Self::Cosine(v, _) => name(v),
        }
    }

    /// As an expression of the model file.
    pub(crate) fn text(self, name: impl Fn(usize) -> String) -> String {
        match self {
            Self::Plain(v) => name(v),
            Self::Sign(v) => format!("sign({})", name(v)),
            Self::Drag(v) => format!("{0}*abs({0})", name(v)),
            Self::Square(v) => format!("{}^2", name(v)),
            Self::Product(v, w) => format!("{}*{}", name(v), name(w)),
            Self::Bend(v, w) => format!("{}^2*{}", name(v), name(w)),
            Self::Sine(v, 1) => format!("sin({})", name(v)),
            Self::Cosine(v, 1) => format!("cos({})", name(v)),
            Self::Sine(v, n) => format!("sin({n}*{})", name(v)),
            Self::Cosine(v, n) => format!("cos({n}*{})", name(v)),
        }
    }

    /// The term of `--candidate` for this form: waves have a phase, and a real-valued number of periods.
    pub(crate) fn term(
        self,
        name: impl Fn(usize) -> String,
        free: impl Fn(&str) -> String,
    ) -> String {
        match self {
            Self::Sine(v, n) | Self::Cosine(v, n) => {
                let (name, [a, b, waves]) = (name(v), ["a", "b", "n"].map(free));
                let (low, high) = (f64::from(n) - 0.5, f64::from(n) + 0.5);
                format!(
                    "{a}*sin({waves}*{name}) + {b}*cos({waves}*{name}); {waves} = {n} in {low} to {high}"
                )
            }
            _ => format!("{}*{}", free("k"), self.text(name)),
        }
    }

    /// All functions of so many variables, of which some are angles in radians.
    pub(crate) fn all(variables: usize, angles: &[usize]) -> Vec<Self> {
        let of_one = [Self::Plain as fn(usize) -> Self, Self::Sign, Self::Drag, Self::Square];
        let mut all: Vec<Self> = of_one.iter().flat_map(|form| (0..variables).map(form)).collect();
        if variables <= VARIABLES {
            all.extend((0..variables).flat_map(|v| (0..v).map(move |w| Self::Product(w, v))));
            let others = |v: usize| (0..variables).filter(move |w| *w != v);
            all.extend((0..variables).flat_map(|v| others(v).map(move |w| Self::Bend(v, w))));
        }
        for form in [Self::Sine as fn(usize, u8) -> Self, Self::Cosine] {
            all.extend(angles.iter().flat_map(|v| (1..=WAVES).map(move |n| form(*v, n))));
        }
        all
    }

    /// The products of two of so many variables, and their squares.
    pub(crate) fn of_second_order(variables: usize) -> impl Iterator<Item = Self> {
        let products = if variables <= VARIABLES { variables } else { 0 };
        let products = (0..products).flat_map(|v| (0..v).map(move |w| Self::Product(w, v)));
        (0..variables).map(Self::Square).chain(products)
    }
}
