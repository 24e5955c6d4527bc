//! From a sampled model back to the continuous one behind a zero-order hold.

use nalgebra::DMatrix;

use super::{ModelError, Sampled, StateSpace, matrix};

/// The continuous model whose zero-order-hold conversion is `sys`: log of [A B; 0 I] over Ts. Whole-sample delays become seconds.
///
/// # Errors
/// [`ModelError::NoLogarithm`] for a pole at z = 0 or on the negative real axis (no real continuous model has it).
pub fn d2c(sys: &StateSpace<Sampled>) -> Result<StateSpace<super::Continuous>, ModelError> {
    let (n, m) = (sys.order(), sys.inputs());
    let mut block = DMatrix::<f64>::identity(n + m, n + m);
    block.view_mut((0, 0), (n, n)).copy_from(sys.a());
    block.view_mut((0, n), (n, m)).copy_from(sys.b());
    let ts = sys.sample_time().seconds();
    let log = matrix::log(&block).map_err(|re| ModelError::NoLogarithm { re })? / ts;
    let (a, b) = (log.view((0, 0), (n, n)).into_owned(), log.view((0, n), (n, m)).into_owned());
    #[allow(clippy::cast_precision_loss)]
    let delays = sys.input_delay().iter().map(|&d| sys.sample_time().to_seconds(d as f64)).collect();
    StateSpace::continuous(a, b, sys.c().clone(), sys.d().clone())?.with_input_delay(delays)
}
