//! A method of subspace identification, and the identified model.

use super::bootstrap::Blocks;
use super::innovations::{Direct, InnovationsModel};
use super::n4sid::Weight;
use super::order::OrderChoice;
use super::pbsidopt::Predictor;
use super::recordings::Factor;
use super::recordings::{Named, Recordings, Scales, Stretch};
use super::search::{Search, Way};
use super::uncertainty::{Draws, Response, Root};
use super::validation::OutputCheck;
use super::{innovations, moesp, n4sid, order, pbsidopt, search, uncertainty, validation};
use crate::error::IdentifyError;
use crate::parametric::Parametric;
use deadtime_model::{Channel, ModelError, ModelFile, Operating, Sampled, State, StateSpace, d2c};
use deadtime_signal::parallel;
use deadtime_signal::progress::HowFar;
use deadtime_signal::registry::{Entry, entry};
use deadtime_signal::time::SampleTime;
use nalgebra::DMatrix;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// A method that makes a model of records; the implementor is its option struct.
pub trait Identifier: Send + Sync {
    /// The model, in the records' own units.
    ///
    /// # Errors
    /// [`IdentifyError`] for too few rows, inputs that are constant, collinear or excite too little, an order that the window cannot resolve.
    fn identify(&self, recordings: &Recordings, far: &HowFar) -> Result<Identified, IdentifyError>;
}

/// A line of the list of methods.
pub struct IdentifierLine {
    /// Name, summary, options.
    pub entry: Entry<dyn Identifier>,
    /// The requirements on the data.
    pub needs: &'static str,
    /// The method estimates the dead times itself, so none are removed first.
    pub finds_delays: bool,
    /// The method is biased where the inputs depend on the outputs.
    pub open_loop: bool,
}

/// The line of [`Pbsidopt`].
pub const PBSIDOPT: IdentifierLine = IdentifierLine {
    entry: entry!(
        "pbsidopt",
        "predictor-based subspace identification, with standard deviations",
        Pbsidopt,
        dyn Identifier
    ),
    needs: "rich inputs, a past window that outlasts the predictor's memory; open or closed loop, stable or unstable",
    finds_delays: false,
    open_loop: false,
};

/// The line of [`N4sid`].
pub const N4SID: IdentifierLine = IdentifierLine {
    entry: entry!("n4sid", "subspace identification by oblique projection", N4sid, dyn Identifier),
    needs: "rich inputs that do not depend on the outputs (no feedback)",
    finds_delays: false,
    open_loop: true,
};

/// The line of [`Moesp`].
pub const MOESP: IdentifierLine = IdentifierLine {
    entry: entry!(
        "moesp",
        "subspace identification by orthogonal projection, past inputs and outputs as instruments",
        Moesp,
        dyn Identifier
    ),
    needs: "rich inputs that do not depend on the outputs (no feedback)",
    finds_delays: false,
    open_loop: true,
};

/// Options of all subspace methods.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// States; `None`: chosen by Schwarz's criterion among 1 to `max_order`.
    pub order: Option<usize>,
    /// Past samples in the predictor; `None`: 1.5 times the number from Akaike's criterion of the long predictor, at most 60. The window must exceed the
    /// predictor's memory: truncation is a bias outside every interval.
    pub past: Option<usize>,
    /// Largest number of states tested; default 12.
    pub max_order: usize,
    /// Whether inputs act within the sample; default no.
    pub direct: Direct,
    /// Drawn models for bands, and as many small ones for standard deviations; default 200; 0: none.
    pub draws: usize,
    /// Replicates of a block bootstrap instead of the draws; default 0: none. N4SID and MOESP use it; bands need at least 50.
    pub bootstrap: usize,
    /// Seed of the draws; default 1.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            order: None,
            past: None,
            max_order: 12,
            direct: Direct::None,
            draws: 200,
            bootstrap: 0,
            seed: 1,
        }
    }
}

/// Predictor-based subspace identification (PBSIDopt).
///
/// A long predictor (ARX with exogenous inputs, `past` samples) gives C(A − KC)ʲ[B K], and with them the predictions of future outputs. The singular value
/// decomposition of the predictions (weighted by the innovations' covariance) is observability matrix times states. Regressions give A, B, C, D and K. All
/// steps use one triangular factor of the lagged data.
/// Assumes: the outputs depend on past inputs and past noise; consistent also under feedback, for stable and unstable plants.
/// Fails when: the past is shorter than the predictor's memory (a bias), or the inputs excite too little. At least three times as many rows as parameters are
/// required.
/// Source: Chiuso (2007), Automatica 43(6), 1034-1048, doi:10.1016/j.automatica.2006.12.005; Houtzager, van Wingerden and Verhaegen (2009), "VARMAX-based
/// closed-loop subspace model identification", doi:10.1109/CDC.2009.5400695; van der Veen et al. (2013), doi:10.1049/iet-cta.2012.0653.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Pbsidopt(pub Settings);

/// Subspace identification by oblique projection of future outputs along future inputs on the past (N4SID).
///
/// Source: Van Overschee and De Moor (1994), Automatica 30(1), 75-93, doi:10.1016/0005-1098(94)90230-5; the states' regressions as in [`Pbsidopt`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct N4sid(pub Settings);

/// Subspace identification by orthogonal projection with past inputs and outputs as instruments (PO-MOESP).
///
/// The shift of the observability matrix gives A and C. Least squares of a free run give B and D, or of an observer's run where A does not decay. For these,
/// inputs of few lines suffice; K needs states, and with them richer inputs.
/// Source: Verhaegen (1994), Automatica 30(1), 61-74, doi:10.1016/0005-1098(94)90229-1.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Moesp(pub Settings);

impl Identifier for Pbsidopt {
    fn identify(&self, recordings: &Recordings, far: &HowFar) -> Result<Identified, IdentifyError> {
        self.0.identify("pbsidopt", None, recordings, far)
    }
}

impl Identifier for N4sid {
    fn identify(&self, recordings: &Recordings, far: &HowFar) -> Result<Identified, IdentifyError> {
        self.0.identify("n4sid", Some(Weight::Past), recordings, far)
    }
}

impl Identifier for Moesp {
    fn identify(&self, recordings: &Recordings, far: &HowFar) -> Result<Identified, IdentifyError> {
        self.0.identify("moesp", Some(Weight::PastBesideInputs), recordings, far)
    }
}

/// An identified model, with its data.
#[derive(Debug, Clone, PartialEq)]
pub struct Identified {
    /// The method.
    pub method: &'static str,
    /// The sample time.
    pub sample_time: SampleTime,
    /// The inputs.
    pub inputs: Vec<Named>,
    /// The outputs.
    pub outputs: Vec<Named>,
    /// The model, of deviations from the operating point.
    pub model: InnovationsModel,
    /// Operating point, and standard deviations of the data.
    pub scales: Scales,
    /// The past window, samples.
    pub past: usize,
    /// Samples with a complete past.
    pub rows: usize,
    /// The order.
    pub order: OrderChoice,
    /// Covariance of the innovations, in the outputs' units.
    pub innovations: DMatrix<f64>,
    /// Drawn models; empty for a method without draws.
    pub draws: Draws,
    /// Notes for the reader.
    pub notes: Vec<String>,
    /// The parameters of a given structure; absent for a model of states alone.
    pub parametric: Option<Parametric>,
}

/// Progress after the choice of the past window; the states and the orders follow.
pub(super) const PAST: f64 = 0.3;

pub(super) const STATES: f64 = 0.5;

pub(super) const ORDERS: f64 = 0.7;

/// Size of the small draws relative to a whole one.
pub(super) const STEP: f64 = 1e-3;

/// Longest default past window.
pub(super) const LONGEST: usize = 60;

/// Factor on Akaike's window: the criterion balances truncation against noise in the one-step error, but a bias is worse than its share of that error.
pub(super) const BEYOND_AKAIKE: f64 = 1.5;

impl Settings {
    fn check(&self) -> Result<(), IdentifyError> {
        for (option, value) in
            [("order", self.order), ("past", self.past), ("max_order", Some(self.max_order))]
        {
            if value == Some(0) {
                return Err(IdentifyError::Option {
                    option,
                    value: 0.0,
                    rule: "it must be 1 or more",
                });
            }
        }
        Ok(())
    }

    /// Samples of the past window: as requested, or by Akaike's criterion as far as the rows allow.
    fn past_window(
        &self,
        weight: Option<Weight>,
        recordings: &Recordings,
        scales: &Scales,
    ) -> Result<usize, IdentifyError> {
        let (m, l) = (recordings.inputs.len(), recordings.outputs.len());
        let double = if weight.is_some() { 2 } else { 1 };
        let needed = |past: usize| needed(weight, past, (m, l));
        let carried = |past: usize| recordings.rows(double * past) >= needed(past);
        let longest =
            (1..=LONGEST.max(self.past.unwrap_or(0))).rev().find(|p| carried(*p)).unwrap_or(0);
        let wanted = self.past.unwrap_or(1);
        if longest < wanted {
            let got = recordings.rows(double * wanted);
            return Err(IdentifyError::TooFewRows {
                past: wanted,
                needed: needed(wanted),
                got,
                longest,
            });
        }
        let least = self.order.map_or(8, |n| n.div_ceil(l) + 2);
        Ok(self.past.unwrap_or_else(|| {
            let searched = (longest.min(LONGEST) as f64 / BEYOND_AKAIKE) as usize;
            let akaike = pbsidopt::past_by_akaike(recordings, scales, searched.max(1), least);
            ((BEYOND_AKAIKE * akaike as f64).ceil() as usize).min(longest)
        }))
    }

    /// The regression on the past, and the orders to which each input excites it.
    ///
    /// # Errors
    /// [`IdentifyError`] for an order beyond the window, inputs that excite too little, a regression without explanatory power.
    fn search<'r>(
        &self,
        method: &'static str,
        weight: Option<Weight>,
        recordings: &'r Recordings,
        far: &HowFar,
    ) -> Result<(Search<'r>, Vec<usize>), IdentifyError> {
        far.at(0.0, &"choosing the past window");
        let scales = recordings.scales()?;
        let (m, l) = (recordings.inputs.len(), recordings.outputs.len());
        let past = self.past_window(weight, recordings, &scales)?;
        far.at(PAST, &"regression on the past");
        let factor = recordings.factor(past, &scales);
        let orders = factor.excitation(&recordings.inputs)?;
        let most = (past * l).min(past * (m + l));
        if let Some(order) = self.order.filter(|n| *n > most) {
            return Err(IdentifyError::Order { order, past, most });
        }
        let needed = self.order.unwrap_or(1);
        if let Some((channel, orders)) = poor(recordings, &orders, needed + 1, past) {
            return Err(IdentifyError::NotRich { channel, orders, needed });
        }
        let tried = self.order.unwrap_or(0).max(self.max_order).min(most);
        let way = Way { weight, direct: self.direct, past, most: tried };
        let search = Search::of(recordings, scales, factor, way).ok_or(IdentifyError::Numeric {
            method,
            reason: "the inputs and the past explain nothing of the outputs; check the channels, or record with a stronger excitation",
        })?;
        if let Some(order) = self.order.filter(|n| *n > search.orders()) {
            return Err(IdentifyError::Order { order, past, most: search.orders() });
        }
        Ok((search, orders))
    }

    fn identify(
        &self,
        method: &'static str,
        weight: Option<Weight>,
        recordings: &Recordings,
        far: &HowFar,
    ) -> Result<Identified, IdentifyError> {
        self.check()?;
        let (search, orders) = self.search(method, weight, recordings, far)?;
        let order = self.chosen(&search, recordings, &far.part(STATES, ORDERS));
        let (model, residual, scales) = search.model(order.order);
        if !model.is_finite() {
            let reason = "the regressions have no finite solution; choose a smaller order";
            return Err(IdentifyError::Numeric { method, reason });
        }
        far.part(ORDERS, 1.0).at(0.0, &"drawing models for the intervals");
        let draws = if self.bootstrap > 0 {
            self.replicated(&search, recordings, order.order, &scales)
        } else if weight.is_some() {
            Draws::default()
        } else {
            self.drawn(&search, order.order, &scales)
        };
        let Search { factor, predictor, way, .. } = &search;
        let freedom = factor.rows.saturating_sub(predictor.parameters() + 1).max(1) as f64;
        let spread: Vec<f64> = scales.outputs.iter().map(|s| s.1).collect();
        let covariance = residual.transpose() * residual / freedom;
        let few = poor(recordings, &orders, 2 * order.order, way.past);
        let l = recordings.outputs.len();
        Ok(Identified {
            method,
            sample_time: recordings.sample_time,
            inputs: recordings.inputs.clone(),
            outputs: recordings.outputs.clone(),
            model: model.in_units(&scales),
            past: way.past,
            rows: factor.rows,
            order,
            innovations: DMatrix::from_fn(l, l, |i, j| covariance[(i, j)] * spread[i] * spread[j]),
            draws,
            notes: notes(method, weight, few, undetermined(recordings, predictor, factor)),
            scales,
            parametric: None,
        })
    }

    /// The order: as given, by Schwarz's criterion, or by free runs of held-out data if these reject the latter.
    fn chosen(&self, search: &Search, recordings: &Recordings, far: &HowFar) -> OrderChoice {
        let Way { weight, past, .. } = search.way;
        let (m, l) = (recordings.inputs.len(), recordings.outputs.len());
        let steps = far.steps(search.orders(), "orders tried");
        let loss = |order: usize| {
            let (model, _, scales) = search.model(order);
            let loss = order::log_loss(&model, &recordings.scaled(&scales), past);
            steps.one_more();
            loss
        };
        let losses: Vec<Option<f64>> = parallel::map(1..=search.orders(), loss);
        let free = if self.order.is_some() {
            None
        } else {
            search::free_runs(search, recordings, needed(weight, past, (m, l)))
        };
        let free = free.unwrap_or_default();
        let rows = search.factor.rows;
        order::choose(self.order, (&losses, &free), &search.states.singular, rows, (m, l))
    }

    /// Standard normal numbers of one draw.
    fn normal(&self, draw: usize, predictor: &Predictor, outputs: usize) -> DMatrix<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        rng.set_stream(draw as u64);
        DMatrix::from_fn(predictor.parameters(), outputs, |_, _| StandardNormal.sample(&mut rng))
    }

    fn drawn(&self, search: &Search, order: usize, scales: &Scales) -> Draws {
        let Search { factor, predictor, states, .. } = search;
        let y = factor.y();
        let draw = |i: usize, size: f64| {
            let change = predictor.change(&self.normal(i, predictor, factor.layout.l)) * size;
            let theta = &predictor.theta + &change;
            // The outputs of the same innovations with another predictor.
            let y = &y + factor.r.columns(0, change.nrows()) * &change;
            let predictions = pbsidopt::predictions(&theta, factor, factor.layout.past);
            innovations::of_states(factor, &y, &states.map(&predictions, order), self.direct)
                .0
                .in_units(scales)
        };
        let all = |size: f64| {
            let drawn = parallel::map(0..self.draws, |i| draw(i, size));
            drawn.into_iter().filter(InnovationsModel::is_finite).collect()
        };
        Draws { whole: all(1.0), small: all(STEP), step: STEP, ..Draws::default() }
    }

    /// Models of replicates of a block bootstrap, in the states of the model.
    fn replicated(
        &self,
        search: &Search,
        recordings: &Recordings,
        order: usize,
        scales: &Scales,
    ) -> Draws {
        let Way { weight, past, .. } = search.way;
        let (states, noise) = (&search.states, &search.predictor.noise);
        let pasts = if weight.is_some() { vec![past, 2 * past] } else { vec![past] };
        let blocks = Blocks::of(recordings, &pasts, scales, self.seed);
        let scaled = recordings.scaled(scales);
        let one = |number: usize| {
            let (factors, weights) = blocks.replicate(number);
            let factor = factors.first()?;
            let y = factor.y();
            let (predictions, right) = match (weight, factors.get(1)) {
                (Some(weight), Some(double)) => n4sid::oblique(double, weight),
                _ => pbsidopt::predicted(&Predictor::fit(factor, self.direct), factor),
            };
            let map = states.map(&predictions, order);
            let model = if weight == Some(Weight::PastBesideInputs) {
                let gamma = moesp::observability(&predictions, &right, &map);
                let of = |s: usize, t: usize| {
                    weights.get(s).and_then(|w| w.get(t)).copied().unwrap_or(1.0)
                };
                moesp::realise((factor, &y), (&map, &gamma), (noise, self.direct), &scaled, &of).0
            } else {
                innovations::of_states(factor, &y, &map, self.direct).0
            };
            Some(model.in_units(scales))
        };
        let mut whole = parallel::filter_map(0..self.bootstrap, one);
        whole.retain(InnovationsModel::is_finite);
        Draws { small: whole.clone(), whole, step: 1.0, ..Draws::default() }
    }
}

/// Required rows: three times the regressors of one output; projections look as far ahead as back.
fn needed(weight: Option<Weight>, past: usize, (m, l): (usize, usize)) -> usize {
    let double = if weight.is_some() { 2 } else { 1 };
    3 * (double * past * (m + l) + m)
}

/// The first input excited at fewer than `needed` lags (of a window of `past`), and their number.
fn poor(
    recordings: &Recordings,
    orders: &[usize],
    needed: usize,
    past: usize,
) -> Option<(String, usize)> {
    let at = orders.iter().position(|o| *o < needed.min(past))?;
    Some((recordings.inputs[at].name.clone(), orders[at]))
}

/// The first input for which the noise leaves part of the past window undetermined.
fn undetermined(recordings: &Recordings, predictor: &Predictor, factor: &Factor) -> Option<String> {
    let past = factor.layout.past;
    let known = predictor.determined(factor.layout);
    let (input, known) = recordings.inputs.iter().zip(known).find(|(_, known)| *known < past)?;
    Some(format!(
        "{} determines {known} of the {past} lags of the past window at this noise, so states beyond these are noise: use a richer excitation, a smaller past, or --method riv",
        input.name
    ))
}

/// Notes on a subspace model.
fn notes(
    method: &str,
    weight: Option<Weight>,
    poor: Option<(String, usize)>,
    undetermined: Option<String>,
) -> Vec<String> {
    let poor = poor.map(|(name, orders)| {
        format!(
            "{name} is distinguishable from its past at {orders} lags only; twice the order would be safe: use a richer excitation"
        )
    });
    let biased = weight.map(|_| {
        format!(
            "{method} is biased where the inputs depend on the outputs; under feedback use pbsidopt"
        )
    });
    poor.into_iter().chain(undetermined).chain(biased).collect()
}

impl Identified {
    /// The model without its predictor, behind these input delays (samples).
    ///
    /// # Errors
    /// [`ModelError::Count`] for another number of delays.
    pub fn system(&self, delays: &[usize]) -> Result<StateSpace<Sampled>, ModelError> {
        uncertainty::system(&self.model, self.sample_time, delays)
    }

    /// Independent deviations of A, B, C and D of one standard deviation each, in row-major order, A first; empty for a method without uncertainty.
    #[must_use]
    pub fn deviations(&self) -> Vec<Vec<f64>> {
        uncertainty::deviations(&self.model, &self.draws)
    }

    /// The poles, with standard deviations from the draws.
    #[must_use]
    pub fn poles(&self) -> Vec<Root> {
        let none = vec![0; self.inputs.len()];
        let of = |m: &InnovationsModel| {
            uncertainty::system(m, self.sample_time, &none).map(|s| s.poles()).unwrap_or_default()
        };
        let drawn: Vec<_> = self.draws.small.iter().map(of).collect();
        uncertainty::roots(&of(&self.model), &drawn, self.draws.step, self.sample_time)
    }

    /// The invariant zeros, with standard deviations from the draws if their number is constant.
    #[must_use]
    pub fn zeros(&self) -> Vec<Root> {
        let none = vec![0; self.inputs.len()];
        let of = |m: &InnovationsModel| {
            uncertainty::system(m, self.sample_time, &none).map(|s| s.zeros()).unwrap_or_default()
        };
        let drawn: Vec<_> = self.draws.small.iter().map(of).collect();
        uncertainty::roots(&of(&self.model), &drawn, self.draws.step, self.sample_time)
    }

    /// Frequency responses of every pair behind these input delays, at `count` frequencies.
    ///
    /// # Errors
    /// As [`Self::system`].
    pub fn responses(&self, delays: &[usize], count: usize) -> Result<Vec<Response>, ModelError> {
        let frequencies = uncertainty::frequencies(self.sample_time, self.rows, count);
        let found = uncertainty::responses(&self.system(delays)?, &self.draws, &frequencies);
        let mut responses = Vec::new();
        for (input, of_input) in self.inputs.iter().zip(found) {
            for (output, bands) in self.outputs.iter().zip(of_input) {
                responses.push(Response {
                    input: input.name.clone(),
                    output: output.name.clone(),
                    bands,
                });
            }
        }
        Ok(responses)
    }

    /// The fit of the model to records of the same channels (inputs behind the same delays).
    #[must_use]
    pub fn check(&self, recordings: &Recordings) -> Vec<OutputCheck> {
        let centred: Vec<Stretch> =
            recordings.stretches.iter().map(|s| self.scales.centred(s)).collect();
        // An integrator has a free run, too: its initial state is estimated.
        let edge = if self.parametric.is_some() { 1.0 + 1e-9 } else { 1.0 };
        let runs = self.poles().iter().all(|p| p.re.hypot(p.im) < edge);
        let noise = self.parametric.as_ref().map(|p| p.noise.as_slice());
        validation::check(
            (&self.model, noise),
            &centred,
            self.past,
            (&self.inputs, &self.outputs),
            runs,
        )
    }

    /// The model file: sampled, or the continuous model behind a zero-order hold; always continuous for a continuous structure.
    ///
    /// # Errors
    /// [`ModelError::NoLogarithm`] where a sampled pole has no continuous counterpart, [`ModelError::Count`].
    pub fn file(
        &self,
        name: &str,
        delays: &[usize],
        continuous: bool,
    ) -> Result<ModelFile, ModelError> {
        let channel = |named: &Named, mean: f64| Channel {
            operating: Operating::Value(mean),
            ..Channel::plain(&named.name, named.unit.as_deref())
        };
        let channels = |names: &[Named], scales: &[(f64, f64)]| {
            names.iter().zip(scales).map(|(n, s)| channel(n, s.0)).collect::<Vec<_>>()
        };
        let (inputs, outputs) = (
            channels(&self.inputs, &self.scales.inputs),
            channels(&self.outputs, &self.scales.outputs),
        );
        let states = |order: usize| {
            (1..=order).map(|i| State { name: format!("x{i}"), unit: None }).collect()
        };
        if let Some(own) = self.parametric.as_ref().and_then(|p| p.continuous.as_ref()) {
            return ModelFile::from_continuous(name, own, inputs, states(own.order()), outputs);
        }
        let system = self.system(delays)?;
        if continuous {
            ModelFile::from_continuous(
                name,
                &d2c(&system)?,
                inputs,
                states(self.model.order()),
                outputs,
            )
        } else {
            ModelFile::from_sampled(name, &system, inputs, Vec::new(), outputs)
        }
    }
}
