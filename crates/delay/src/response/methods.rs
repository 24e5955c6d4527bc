//! The list of estimators from frequency responses.

use super::estimator::ResponseMethod;
use super::{bode, rational};

/// Every estimator, the most trusted first.
pub const RESPONSE_METHODS: &[ResponseMethod] = &[rational::METHOD, bode::METHOD];
