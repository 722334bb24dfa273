//! What four components of a block hold, one RGB triple each: a cache line, and a vector register where those are widest.

/// Components of one [`Quad`].
pub(super) const QUAD: usize = 4;

/// Red of four components, then green, then blue, then four zeros.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(C, align(64))]
pub(super) struct Quad(pub [f32; 16]);

impl Quad {
    /// From one RGB triple per component.
    pub(super) fn from_rgb(components: [[f32; 3]; QUAD]) -> Self {
        let value = |i: usize| if i < 12 { components[i % QUAD][i / QUAD] } else { 0.0 };
        Self(std::array::from_fn(value))
    }

    /// RGB triple of one component.
    pub(super) fn rgb(&self, component: usize) -> [f32; 3] {
        [self.0[component], self.0[QUAD + component], self.0[2 * QUAD + component]]
    }

    /// `self + other`, entry by entry.
    pub(super) fn plus(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }

    /// `self · other`, entry by entry.
    pub(super) fn times(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|i| self.0[i] * other.0[i]))
    }
}
