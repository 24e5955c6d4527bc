//! Many parameters of an equations model at once, from logs: windows of H steps, each starting from the log's own row.
//!
//! Equation:  θ̂ = argmin Σ_windows Σ_h Σ_groups ρ(‖e_gh(θ)‖ / σ_gh) + λ Σ_j ((θ_j − θ0_j)/s_j)²
//!
//! e_gh is the error of a group of outputs (attitudes: the rotation vector) h steps after a window's start, σ_gh its median length. ρ is Huber's loss, θ0 the
//! model file's values and s_j each parameter's size. The solver is Gauss-Newton with exact sensitivities; cross-validation over records (or stretches) gives
//! λ.
//!
//! Assumes: the log's rows are accurate initial states; with noisy rows, short horizons evaluate the sensors instead of the model.
//! Fails when: parameters are correlated. The result then names the undetermined combination.
//! Source: Huber (1964), doi:10.1214/aoms/1177703732, for ρ; White (1980), doi:10.2307/1912934, for the covariance over clusters; Marquardt (1963) for the search.

mod answer;
pub(crate) mod error;
mod fit;
mod fitted;
pub(crate) mod free;
mod group;
mod hold;
pub(crate) mod known;
mod problem;
mod record;
mod runs;
mod score;
mod shrinkage;
mod starts;
#[cfg(test)]
mod tests;
mod window;

pub use answer::{FreeParameter, StructuredFit};
pub use error::StructuredError;
pub use fit::{Balance, Structured, score};
pub use known::{Standing, Unseen};
pub use runs::WindowRun;
pub use score::GroupScore;
