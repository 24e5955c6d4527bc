//! Models of every order from one decomposition, and their free-run errors on the last part of each record.

use nalgebra::DMatrix;

use super::innovations::{Direct, InnovationsModel, decays};
use super::n4sid::Weight;
use super::offset::Constants;
use super::order::FreeRuns;
use super::pbsidopt::{Predictor, States};
use super::recordings::{Factor, Recordings, Scales, Stretch};
use super::{innovations, moesp, n4sid, offset, pbsidopt};
use deadtime_signal::parallel;

/// Share of each record for the models; free runs over the remainder evaluate them.
const LEARNT: f64 = 0.7;
/// Contiguous blocks of the remainder, over which errors are compared.
pub(super) const BLOCKS: usize = 10;

/// The method and windows for finding states.
#[derive(Debug, Clone, Copy)]
pub(super) struct Way {
    /// `None`: PBSIDopt.
    pub(super) weight: Option<Weight>,
    pub(super) direct: Direct,
    pub(super) past: usize,
    /// Largest number of states.
    pub(super) most: usize,
}

/// The common data of the models of all orders.
pub(super) struct Search<'a> {
    pub(super) way: Way,
    recordings: &'a Recordings,
    pub(super) scales: Scales,
    pub(super) factor: Factor,
    pub(super) predictor: Predictor,
    predictions: DMatrix<f64>,
    right: DMatrix<f64>,
    pub(super) states: States,
    y: DMatrix<f64>,
    scaled: Vec<Stretch>,
    extent: Vec<f64>,
}

impl<'a> Search<'a> {
    /// `None` where inputs and past do not explain the outputs.
    pub(super) fn of(
        recordings: &'a Recordings,
        scales: Scales,
        factor: Factor,
        way: Way,
    ) -> Option<Self> {
        let predictor = Predictor::fit(&factor, way.direct);
        let (predictions, right) = match way.weight {
            None => pbsidopt::predicted(&predictor, &factor),
            Some(weight) => n4sid::oblique(&recordings.factor(2 * way.past, &scales), weight),
        };
        let states = States::of(&predictions, &right, factor.rows, &predictor.noise, way.most)?;
        let (y, scaled, extent) =
            (factor.y(), recordings.scaled(&scales), recordings.extent(&scales));
        Some(Self {
            way,
            recordings,
            scales,
            factor,
            predictor,
            predictions,
            right,
            states,
            y,
            scaled,
            extent,
        })
    }

    /// Number of orders of the decomposition.
    pub(super) fn orders(&self) -> usize {
        self.states.rows.nrows()
    }

    /// The model of an order, of scaled deviations about its own operating point; and its residuals.
    pub(super) fn model(&self, order: usize) -> (InnovationsModel, DMatrix<f64>, Scales) {
        let map = self.states.map(&self.predictions, order);
        let about = |model: &InnovationsModel, constants: &Constants| {
            self.scales.about(&offset::at_rest(constants, model, &self.extent))
        };
        let Way { weight, direct, past, .. } = self.way;
        if weight == Some(Weight::PastBesideInputs) {
            let gamma = moesp::observability(&self.predictions, &self.right, &map);
            let (model, constants) = moesp::realise(
                (&self.factor, &self.y),
                (&map, &gamma),
                (&self.predictor.noise, direct),
                &self.scaled,
                &|_, _| 1.0,
            );
            let scales = about(&model, &constants);
            let residual = moesp::residuals(&model, &self.recordings.scaled(&scales), past);
            return (model, residual, scales);
        }
        let (model, residual) = innovations::of_states(&self.factor, &self.y, &map, direct);
        let scales = about(&model, &Constants::of(&self.factor, &map, &model));
        (model, residual, scales)
    }
}

/// Errors on the remainder, by order, of models of the first part of each record; the whole record's model must be stable, too. `None` where a part is too
/// short for `needed` rows or has no models.
pub(super) fn free_runs(
    whole: &Search,
    recordings: &Recordings,
    needed: usize,
) -> Option<Vec<FreeRuns>> {
    let way = whole.way;
    let (first, rest) = recordings.split(LEARNT);
    let double = if way.weight.is_some() { 2 } else { 1 };
    // The initial state of a free run is fitted to the same samples.
    let long = |s: &&Stretch| s.len() > 2 * (way.past + way.most);
    let rest: Vec<&Stretch> = rest.stretches.iter().filter(long).collect();
    if first.rows(double * way.past) < needed || rest.is_empty() {
        return None;
    }
    let scales = first.scales().ok()?;
    let factor = first.factor(way.past, &scales);
    factor.excitation(&first.inputs).ok()?;
    let search = Search::of(&first, scales, factor, way)?;
    let judged = |order: usize| {
        let (model, _, scales) = search.model(order);
        if !model.is_finite() {
            return FreeRuns::default();
        }
        let rest: Vec<Stretch> = rest.iter().map(|s| scales.scaled(s)).collect();
        let one_step: Vec<f64> = rest.iter().flat_map(|s| squares(&model.innovations(s))).collect();
        let stable = decays(&model.a) && decays(&whole.model(order).0.a);
        let free = stable.then(|| {
            rest.iter().flat_map(|s| squares(&(&s.y - model.free_run(s)))).collect::<Vec<f64>>()
        });
        FreeRuns { one_step: blocks(&one_step), free: free.map(|e| blocks(&e)) }
    };
    Some(parallel::map(1..=search.orders().min(whole.orders()), judged))
}

/// Σ over outputs by sample.
fn squares(errors: &DMatrix<f64>) -> Vec<f64> {
    errors.column_iter().map(|e| e.norm_squared()).collect()
}

/// Means of contiguous blocks.
fn blocks(errors: &[f64]) -> Vec<f64> {
    let of = |b: usize| {
        let part = &errors[b * errors.len() / BLOCKS..(b + 1) * errors.len() / BLOCKS];
        part.iter().sum::<f64>() / part.len().max(1) as f64
    };
    (0..BLOCKS).map(of).collect()
}
