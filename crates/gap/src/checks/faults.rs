//! Which signs, units and places of channels make model and log go together: a greedy search over single faults.
//!
//! A model may lack a delay, a lag, friction, or 20 % of its gain. Two signals agree when their correlation at the best lag is high and their
//! standard deviations are similar. An effect of the catalogue is therefore no fault here.

use super::units::{Factor, alternatives};
use super::view::{Columns, Fit, View};
use deadtime_model::effect::{Applied, EFFECTS, Effect, Site};
use deadtime_model::simulate::{Measured, System};
use deadtime_signal::parallel;
use deadtime_signal::progress::HowFar;

/// A correlation from which on two signals go together.
pub(super) const AGREES: f64 = 0.7;
/// From this value on no fault is searched.
pub(super) const GOOD: f64 = 0.95;
/// The correlation that a fault's correction must reach: more than that, as a fault is the exception.
const CONVINCES: f64 = 0.85;
/// The allowed remainder of the former distance to 1: a partial improvement is no correction.
const LEAVES: f64 = 0.25;
/// The allowed reduction at another output.
const FALLS: f64 = 0.1;
/// Sizes that differ by less than this factor are the same: gains are wrong more often than units.
pub(super) const SIZE: f64 = 1.8;
/// Factors between units below this are so close to a wrong gain that the size must agree well,
const SMALL_FACTOR: f64 = 5.0;
/// within this factor.
const CLOSE: f64 = 1.06;
/// The cost of a size that does not quite fit, per unit of its logarithm; decides between neighbouring units.
const SIZE_COST: f64 = 0.05;
/// Scores closer than this are equal.
const EQUAL: f64 = 0.03;

/// A channel of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Port {
    Input(usize),
    Output(usize),
}

/// The possible fault of a channel of a log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Fault {
    Sign(Port),
    Unit(Port, Factor),
    /// Another unit, and the other sign: neither alone makes them go together.
    TurnedUnit(Port, Factor),
    Swap(Port, Port),
}

/// A fault that was found, and others that look the same.
#[derive(Debug, Clone)]
pub(super) struct FoundFault {
    pub(super) fault: Fault,
    pub(super) instead: Vec<Fault>,
    /// The correlation with the correction, of the output that gains most, and before it.
    pub(super) correlation: f64,
    pub(super) before: f64,
    /// Measured over modelled there, before the correction.
    pub(super) ratio: f64,
}

/// The result of the search, and the signals with all corrections made.
pub(super) struct Search {
    pub(super) faults: Vec<FoundFault>,
    /// Per output; `None` where it or its model is constant.
    pub(super) fits: Vec<Option<Fit>>,
    /// Per record.
    pub(super) measured: Vec<Columns>,
    pub(super) modelled: Vec<Columns>,
}

impl Port {
    pub(super) fn name(self, view: &View<'_>) -> String {
        let port = match self {
            Self::Input(k) => view.system.inputs.get(k),
            Self::Output(i) => view.system.outputs.get(i),
        };
        port.map(|p| p.name.clone()).unwrap_or_default()
    }

    pub(super) fn unit<'a>(self, view: &'a View<'_>) -> Option<&'a str> {
        let port = match self {
            Self::Input(k) => view.system.inputs.get(k),
            Self::Output(i) => view.system.outputs.get(i),
        };
        port.and_then(|p| p.unit.as_deref())
    }
}

impl Fault {
    pub(super) fn ports(self) -> Vec<Port> {
        match self {
            Self::Sign(p) | Self::Unit(p, _) | Self::TurnedUnit(p, _) => vec![p],
            Self::Swap(p, q) => vec![p, q],
        }
    }

    /// The effect of the catalogue with the action of the fault; no effect swaps channels.
    pub(super) fn as_effect(self, system: &System) -> Option<Applied> {
        let (port, factor) = match self {
            Self::Sign(port) => (port, -1.0),
            Self::Unit(port, factor) => (port, factor.factor),
            Self::TurnedUnit(port, factor) => (port, -factor.factor),
            Self::Swap(..) => return None,
        };
        let (site, port) = match port {
            Port::Input(k) => (Site::Input, system.inputs.get(k)?),
            Port::Output(i) => (Site::Output, system.outputs.get(i)?),
        };
        let of_effect = |effect: &&'static dyn Effect| {
            let values = effect.of_factor(factor).filter(|_| effect.site() == site)?;
            Some(Applied { values, ..Applied::nominal(system, *effect, &port.name).ok()? })
        };
        EFFECTS.iter().find_map(of_effect)
    }

    fn is_input(self) -> bool {
        self.ports().iter().any(|p| matches!(p, Port::Input(_)))
    }

    /// Takes the fault out of a list of channels of its kind.
    fn correct<T>(self, channels: &mut [T], scale: impl Fn(&mut T, f64)) {
        let index = |p: Port| match p {
            Port::Input(k) | Port::Output(k) => k,
        };
        match self {
            Self::Sign(p) => channels.get_mut(index(p)).into_iter().for_each(|c| scale(c, -1.0)),
            Self::Unit(p, f) => {
                channels.get_mut(index(p)).into_iter().for_each(|c| scale(c, 1.0 / f.factor))
            }
            Self::TurnedUnit(p, f) => {
                channels.get_mut(index(p)).into_iter().for_each(|c| scale(c, -1.0 / f.factor))
            }
            Self::Swap(p, q) => channels.swap(index(p), index(q)),
        }
    }
}

fn scaled(values: &mut [f64], by: f64) {
    values.iter_mut().for_each(|v| *v *= by);
}

/// Model and log with some faults corrected; what does not change is taken from `known`.
fn corrected(
    view: &View<'_>,
    faults: &[Fault],
    known: Option<&Search>,
) -> Option<(Vec<Columns>, Vec<Columns>)> {
    let (inputs, outputs): (Vec<Fault>, Vec<Fault>) = faults.iter().partition(|f| f.is_input());
    let each = 0..view.records.len();
    let modelled = match known.filter(|_| inputs.is_empty()) {
        Some(known) => known.modelled.clone(),
        None => each
            .clone()
            .map(|at| {
                let mut u = view.records[at].inputs.clone();
                inputs.iter().for_each(|f| f.correct(&mut u, |u, by| scaled(u, by)));
                view.modelled(at, &u)
            })
            .collect::<Option<_>>()?,
    };
    let measured = match known.filter(|_| outputs.is_empty()) {
        Some(known) => known.measured.clone(),
        None => each
            .map(|at| {
                let mut y = view.records[at].measured.clone();
                outputs.iter().for_each(|f| {
                    f.correct(&mut y, |m: &mut Measured, by| scaled(&mut m.values, by))
                });
                view.measured(at, &y)
            })
            .collect::<Option<_>>()?,
    };
    Some((measured, modelled))
}

impl Search {
    /// With these faults corrected.
    fn with(view: &View<'_>, faults: &[Fault], known: Option<&Self>) -> Option<Self> {
        let (measured, modelled) = corrected(view, faults, known)?;
        let fits = (0..view.outputs()).map(|i| view.fit(i, &measured, &modelled)).collect();
        Some(Self { faults: Vec::new(), fits, measured, modelled })
    }

    /// `None` where the model cannot be simulated on the logs.
    pub(super) fn run(view: &View<'_>, far: &HowFar) -> Option<Self> {
        let base = Self::with(view, &[], None)?;
        let menu = menu(view);
        let mut corrections: Vec<Fault> = Vec::new();
        let mut state = Self::with(view, &[], Some(&base))?;
        let rounds = view.system.inputs.len() + view.outputs();
        for round in 0..rounds {
            let worst = state.fits.iter().flatten().map(|f| agreement(f, SIZE)).fold(1.0, f64::min);
            if worst >= GOOD {
                break;
            }
            // Channels that move alike go together even when they have changed places; a sign or a unit does not hide so.
            let worth = |fault: &Fault| worst < AGREES || matches!(fault, Fault::Swap(..));
            // The next round has half of the remaining progress: a second round is rare.
            let part = |round: usize| 1.0 - 0.5_f64.powi(round as i32);
            let far = far.part(part(round), part(round + 1));
            let steps = far.steps(menu.len(), "signs, units and channels tried");
            let corrected = |fault: Fault| {
                let faults: Vec<Fault> = corrections.iter().copied().chain([fault]).collect();
                let there = Self::with(view, &faults, Some(&base))?;
                there.convinces(&state, fault).then_some((fault, there))
            };
            let one = |&fault: &Fault| {
                let found = if worth(&fault) { corrected(fault) } else { None };
                steps.one_more();
                found
            };
            let tried: Vec<(Fault, Self)> = parallel::filter_map(menu.iter(), one);
            let score = tried.iter().map(|t| t.1.score()).fold(f64::NEG_INFINITY, f64::max);
            let mut equal = tried.into_iter().filter(|t| t.1.score() >= score - EQUAL);
            let Some((fault, mut next)) = equal.next() else { break };
            let instead = equal.map(|t| t.0).collect();
            let gain = |i: &usize| next.agreement(*i, fault) - state.agreement(*i, fault);
            let most = (0..view.outputs()).max_by(|i, j| gain(i).total_cmp(&gain(j))).unwrap_or(0);
            let of = |s: &Self| s.fits.get(most).copied().flatten();
            next.faults = std::mem::take(&mut state.faults);
            next.faults.push(FoundFault {
                fault,
                instead,
                correlation: of(&next).map_or(0.0, |f| f.along),
                before: of(&state)
                    .map_or(0.0, |f| if -f.against > f.along { f.against } else { f.along }),
                ratio: of(&state).map_or(1.0, |f| f.ratio),
            });
            corrections.push(fault);
            state = next;
        }
        Some(state)
    }

    fn agreement(&self, output: usize, fault: Fault) -> f64 {
        self.fits.get(output).copied().flatten().map_or(0.0, |f| agreement(&f, fault.tolerance()))
    }

    fn score(&self) -> f64 {
        self.fits
            .iter()
            .flatten()
            .map(|f| agreement(f, SIZE) - SIZE_COST * f.ratio.ln().abs())
            .sum()
    }

    /// Some output goes with its model now that did not at all, and none is worse off. A swap must convince for two outputs.
    fn convinces(&self, before: &Self, fault: Fault) -> bool {
        let rises = |i: &usize| {
            let now = self.agreement(*i, fault);
            now >= CONVINCES && 1.0 - now <= LEAVES * (1.0 - before.agreement(*i, fault))
        };
        let rising = (0..self.fits.len()).filter(rises).count();
        let needed = if matches!(fault, Fault::Swap(Port::Output(_), _)) { 2 } else { 1 };
        let falls = |i: usize| self.agreement(i, fault) < before.agreement(i, fault) - FALLS;
        // After a swap one of the two may still have the other sign.
        let swapped = matches!(fault, Fault::Swap(..))
            && self.fits.iter().flatten().any(|f| -f.against >= CONVINCES);
        (rising >= needed || (rising >= 1 && swapped)) && !(0..self.fits.len()).any(falls)
    }
}

impl Fault {
    /// The factor within which the standard deviations must agree for this fault to be accepted.
    fn tolerance(self) -> f64 {
        match self {
            Self::Unit(_, f) | Self::TurnedUnit(_, f)
                if f.factor.ln().abs() < SMALL_FACTOR.ln() =>
            {
                CLOSE
            }
            _ => SIZE,
        }
    }
}

/// The correlation, if the sizes agree within a factor.
pub(super) fn agreement(fit: &Fit, size: f64) -> f64 {
    if fit.ratio.ln().abs() <= size.ln() { fit.along.max(0.0) } else { 0.0 }
}

/// A fit that goes together, up to the size that a wrong gain may have.
pub(super) fn agrees(fit: &Fit) -> bool {
    agreement(fit, SIZE) >= AGREES
}

/// Every single fault there may be; outputs first.
fn menu(view: &View<'_>) -> Vec<Fault> {
    let outputs: Vec<Port> = (0..view.outputs()).map(Port::Output).collect();
    let inputs: Vec<Port> = (0..view.system.inputs.len()).map(Port::Input).collect();
    let mut menu = Vec::new();
    for ports in [&outputs, &inputs] {
        menu.extend(ports.iter().map(|&p| Fault::Sign(p)));
        menu.extend(
            ports.iter().flat_map(|&p| {
                alternatives(p.unit(view)).into_iter().map(move |f| Fault::Unit(p, f))
            }),
        );
        menu.extend(ports.iter().flat_map(|&p| {
            alternatives(p.unit(view)).into_iter().map(move |f| Fault::TurnedUnit(p, f))
        }));
        menu.extend(
            ports
                .iter()
                .enumerate()
                .flat_map(|(at, &p)| ports[at + 1..].iter().map(move |&q| Fault::Swap(p, q))),
        );
    }
    menu
}
