//! Loops compiled for the vector instructions of the processor at hand.

use pulp::{Arch, Simd, WithSimd};

struct Wide<F>(F);

impl<R, F: FnOnce() -> R> WithSimd for Wide<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> R {
        (self.0)()
    }
}

/// Runs a closure compiled for AVX2 where the processor has it, else for the build's target. The
/// closure, and every function it calls, is to be `#[inline(always)]`: others are compiled as
/// usual. Additions and multiplications are not contracted, so that results do not depend on the
/// processor.
#[inline(always)]
pub fn vectorised<R>(work: impl FnOnce() -> R) -> R {
    Arch::new().dispatch(Wide(work))
}
