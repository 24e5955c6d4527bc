//! The predicted cost reduction of an effect given other active effects.

use crate::hypothesis::effects::Hypothesis;
use crate::likelihood::gaussian::{Likelihood, Whitened};
use deadtime_model::effect::Scales;

/// The predicted cost reduction of an effect given others: along its signature, with the others' own directions projected out.
pub(crate) struct GivenFirst {
    pub(crate) first: Hypothesis,
    pub(crate) residual: Whitened,
    pub(crate) cost: f64,
    /// Directions in which the first can still move, orthonormal.
    own: Vec<Whitened>,
}

impl GivenFirst {
    pub(crate) fn new(
        likelihood: &Likelihood<'_>,
        first: &Hypothesis,
        scales: &Scales,
    ) -> Option<Self> {
        let slopes = first.slopes(likelihood, scales)?;
        let mut own: Vec<Whitened> = Vec::new();
        for mut column in slopes.columns {
            let whole = likelihood.inner(&column, &column);
            for q in &own {
                let along = likelihood.inner(q, &column);
                column = column.iter().zip(q).map(|(c, q)| c - q * along).collect();
            }
            let left = likelihood.inner(&column, &column);
            if left > 1e-10 * whole {
                own.push(column.iter().map(|c| c / left.sqrt()).collect());
            }
        }
        let cost = likelihood.inner(&slopes.residual, &slopes.residual);
        Some(Self { first: first.clone(), residual: slopes.residual, cost, own })
    }

    /// The predicted reduction of the cost along a signature, at any size.
    pub(crate) fn predicted_reduction(
        &self,
        likelihood: &Likelihood<'_>,
        signature: &Whitened,
    ) -> f64 {
        let mut along = likelihood.inner(signature, &self.residual);
        let mut length = likelihood.inner(signature, signature);
        for q in &self.own {
            let part = likelihood.inner(q, signature);
            along -= part * likelihood.inner(q, &self.residual);
            length -= part * part;
        }
        if length > 0.0 && along.is_finite() { along * along / length } else { 0.0 }
    }
}
