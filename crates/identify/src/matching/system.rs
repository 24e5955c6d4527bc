//! A linear model in continuous or sampled time: responses, their slopes, and the distance of two models.

use nalgebra::{Complex, DMatrix};

use deadtime_model::c2d::{Conversion, ZeroOrderHold};
use deadtime_model::{
    Continuous, ModelError, NuGap, Peak, Sampled, StateSpace, TimeDomain, nu_gap,
};

pub(super) type GainMatrix = DMatrix<Complex<f64>>;
pub(super) type Matrices = [DMatrix<f64>; 4];

/// Largest number of states for level sets: beyond it, an eigenvalue problem of twice the size per level takes longer than the match.
const MOST_STATES: usize = 150;

/// A delay difference is rounding if it turns the fastest pole's phase by less than this, rad.
const ROUNDING: f64 = 1e-8;

/// A linear model in either time domain.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum System {
    Continuous(StateSpace<Continuous>),
    Sampled(StateSpace<Sampled>),
}

macro_rules! each {
    ($system:expr, $sys:ident => $what:expr) => {
        match $system {
            System::Continuous($sys) => $what,
            System::Sampled($sys) => $what,
        }
    };
}

impl System {
    pub(super) fn sample_time_s(&self) -> Option<f64> {
        each!(self, sys => sys.domain().sample_time_s())
    }

    pub(super) fn response(&self, omega: f64) -> GainMatrix {
        each!(self, sys => sys.frequency_response(omega))
    }

    pub(super) fn matrices(&self) -> Matrices {
        each!(self, sys => [sys.a(), sys.b(), sys.c(), sys.d()].map(Clone::clone))
    }

    /// The poles in the s plane, rad/s; those of a sampled model behind its hold.
    pub(super) fn poles_s(&self) -> Vec<Complex<f64>> {
        match self {
            Self::Continuous(sys) => sys.poles(),
            Self::Sampled(sys) => {
                let ts = sys.sample_time().seconds();
                sys.poles().into_iter().filter(|z| z.norm() > 1e-6).map(|z| z.ln() / ts).collect()
            }
        }
    }

    /// Number of unstable poles.
    pub(super) fn unstable(&self) -> usize {
        match self {
            Self::Continuous(sys) => sys.poles().iter().filter(|p| p.re > 0.0).count(),
            Self::Sampled(sys) => sys.poles().iter().filter(|p| p.norm() > 1.0).count(),
        }
    }

    /// The model plus `step` times a change of A, B, C, D, entry by entry.
    pub(super) fn moved(&self, change: &[f64], step: f64) -> Result<Self, ModelError> {
        let mut matrices = self.matrices();
        let needed = matrices.iter().map(DMatrix::len).sum();
        if change.len() != needed {
            return Err(ModelError::Count {
                what: "numbers of a deviation",
                needed,
                got: change.len(),
            });
        }
        let mut values = change.iter();
        for m in &mut matrices {
            let columns = m.ncols();
            for i in 0..m.len() {
                m[(i / columns, i % columns)] += step * values.next().copied().unwrap_or(0.0);
            }
        }
        self.with(matrices)
    }

    fn with(&self, [a, b, c, d]: Matrices) -> Result<Self, ModelError> {
        Ok(match self {
            Self::Continuous(sys) => Self::Continuous(
                StateSpace::continuous(a, b, c, d)?.with_input_delay(sys.input_delay().to_vec())?,
            ),
            Self::Sampled(sys) => Self::Sampled(
                StateSpace::sampled(a, b, c, d, sys.sample_time())?
                    .with_input_delay(sys.input_delay().to_vec())?,
            ),
        })
    }

    /// The outputs and inputs with these indices, in these units.
    pub(super) fn selected(
        &self,
        outputs: &[(usize, f64)],
        inputs: &[(usize, f64)],
    ) -> Result<Self, ModelError> {
        let [a, b, c, d] = self.matrices();
        let b = DMatrix::from_fn(a.nrows(), inputs.len(), |i, j| b[(i, inputs[j].0)] * inputs[j].1);
        let c =
            DMatrix::from_fn(outputs.len(), a.nrows(), |i, j| c[(outputs[i].0, j)] / outputs[i].1);
        let d = DMatrix::from_fn(outputs.len(), inputs.len(), |i, j| {
            d[(outputs[i].0, inputs[j].0)] * inputs[j].1 / outputs[i].1
        });
        Ok(match self {
            Self::Continuous(sys) => {
                let delays = inputs.iter().map(|(j, _)| sys.input_delay()[*j]).collect();
                Self::Continuous(StateSpace::continuous(a, b, c, d)?.with_input_delay(delays)?)
            }
            Self::Sampled(sys) => {
                let delays = inputs.iter().map(|(j, _)| sys.input_delay()[*j]).collect();
                Self::Sampled(
                    StateSpace::sampled(a, b, c, d, sys.sample_time())?.with_input_delay(delays)?,
                )
            }
        })
    }

    /// A continuous model in the time domain of this one: itself, or sampled behind a zero-order hold.
    pub(super) fn in_time_of(
        &self,
        continuous: StateSpace<Continuous>,
    ) -> Result<Self, ModelError> {
        Ok(match self {
            Self::Continuous(_) => Self::Continuous(continuous),
            Self::Sampled(sys) => {
                Self::Sampled(ZeroOrderHold {}.c2d(&continuous, sys.sample_time())?)
            }
        })
    }

    /// The response and its derivatives by these changes of the matrices; `None` on a pole.
    pub(super) fn slopes(
        &self,
        changes: &[Option<Matrices>],
        omega: f64,
    ) -> Option<(GainMatrix, Vec<Option<GainMatrix>>)> {
        each!(self, sys => slopes(sys, changes, omega))
    }

    /// The largest gain of the difference over a band, exact. `None` for different continuous delays, whose difference is no rational model.
    pub(super) fn farthest(&self, other: &Self, band: [f64; 2]) -> Option<Peak> {
        match behind_common_delays(self, other)? {
            (Self::Continuous(one), Self::Continuous(two)) => {
                difference(&one, &two)?.norm_linf(band)
            }
            (Self::Sampled(one), Self::Sampled(two)) => difference(&one, &two)?.norm_linf(band),
            _ => None,
        }
    }

    /// The nu-gap; `None` where it has no value.
    pub(super) fn nu_gap(&self, other: &Self) -> Option<NuGap> {
        match behind_common_delays(self, other)? {
            (Self::Continuous(one), Self::Continuous(two)) => nu_gap(&one, &two).ok(),
            (Self::Sampled(one), Self::Sampled(two)) => nu_gap(&one, &two).ok(),
            _ => None,
        }
    }
}

/// Both models without their common delays; sampled ones have the remaining delays as states.
fn behind_common_delays(one: &System, two: &System) -> Option<(System, System)> {
    match (one, two) {
        (System::Continuous(a), System::Continuous(b)) if alike(a, b) => {
            Some((one.clone(), two.clone()))
        }
        (System::Sampled(a), System::Sampled(b)) => {
            let shared: Vec<usize> =
                a.input_delay().iter().zip(b.input_delay()).map(|(x, y)| *x.min(y)).collect();
            let without = |sys: &StateSpace<Sampled>| {
                let left = sys.input_delay().iter().zip(&shared).map(|(d, s)| d - s).collect();
                sys.clone()
                    .with_input_delay(left)
                    .and_then(|sys| sys.with_delays_as_states())
                    .ok()
                    .map(System::Sampled)
            };
            Some((without(a)?, without(b)?))
        }
        _ => None,
    }
}

/// Delays that differ by rounding alone, relative to the fastest pole of either model.
fn alike(one: &StateSpace<Continuous>, two: &StateSpace<Continuous>) -> bool {
    let fastest = one.a().norm().max(two.a().norm());
    let apart = |(a, b): (&f64, &f64)| (a - b).abs() * fastest;
    one.input_delay().iter().zip(two.input_delay()).map(apart).all(|phase| phase <= ROUNDING)
}

fn difference<T: TimeDomain>(one: &StateSpace<T>, two: &StateSpace<T>) -> Option<StateSpace<T>> {
    let (n1, n2) = (one.order(), two.order());
    if n1 + n2 > MOST_STATES {
        return None;
    }
    let (m, p) = (one.inputs(), one.outputs());
    let (mut a, mut b, mut c) =
        (DMatrix::zeros(n1 + n2, n1 + n2), DMatrix::zeros(n1 + n2, m), DMatrix::zeros(p, n1 + n2));
    a.view_mut((0, 0), (n1, n1)).copy_from(one.a());
    a.view_mut((n1, n1), (n2, n2)).copy_from(two.a());
    b.rows_mut(0, n1).copy_from(one.b());
    b.rows_mut(n1, n2).copy_from(two.b());
    c.columns_mut(0, n1).copy_from(one.c());
    c.columns_mut(n1, n2).copy_from(&-two.c());
    StateSpace::new(a, b, c, one.d() - two.d(), one.domain()).ok()
}

/// The derivative with R = (pI − A)⁻¹. d(C R B + D) = dC R B + C R dA R B + C R dB + dD.
fn slopes<T: TimeDomain>(
    sys: &StateSpace<T>,
    changes: &[Option<Matrices>],
    omega: f64,
) -> Option<(GainMatrix, Vec<Option<GainMatrix>>)> {
    let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
    let n = sys.order();
    let late = |mut g: GainMatrix| {
        for (mut column, &delay) in g.column_iter_mut().zip(sys.input_delay()) {
            column *= Complex::from_polar(1.0, -omega * sys.domain().delay_s(delay));
        }
        g
    };
    if n == 0 {
        return Some((
            late(complex(sys.d())),
            changes.iter().map(|c| c.as_ref().map(|c| late(complex(&c[3])))).collect(),
        ));
    }
    let resolvent =
        DMatrix::from_diagonal_element(n, n, sys.domain().point(omega)) - complex(sys.a());
    let x = resolvent.clone().lu().solve(&complex(sys.b()))?;
    let y = resolvent.transpose().lu().solve(&complex(sys.c()).transpose())?.transpose();
    let response = late(complex(sys.d()) + complex(sys.c()) * &x);
    let finite = response.iter().all(|v| v.re.is_finite() && v.im.is_finite());
    let slope = |[da, db, dc, dd]: &Matrices| {
        late(complex(dd) + complex(dc) * &x + &y * (complex(da) * &x) + &y * complex(db))
    };
    finite.then(|| (response, changes.iter().map(|c| c.as_ref().map(slope)).collect()))
}
