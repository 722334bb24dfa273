//! Which value something was made of, told from all others without keeping it: what takes its place in memory is not taken for it.

use std::sync::{Arc, Weak};

/// One value behind an [`Arc`].
pub(super) struct Identity<T>(Weak<T>);

impl<T> Identity<T> {
    /// This one.
    pub fn of(value: &Arc<T>) -> Identity<T> {
        Identity(Arc::downgrade(value))
    }
}

impl<T> Clone for Identity<T> {
    fn clone(&self) -> Identity<T> {
        Identity(self.0.clone())
    }
}

impl<T> PartialEq for Identity<T> {
    fn eq(&self, other: &Identity<T>) -> bool {
        self.0.ptr_eq(&other.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_to_lie_where_another_one_lay_is_not_that() {
        let first = Arc::new([0u8; 64]);
        let known = Identity::of(&first);
        assert!(known == Identity::of(&first.clone()));
        drop(first);
        // The next one of this size would have its place.
        let others: Vec<Arc<[u8; 64]>> = (0..100).map(|_| Arc::new([0; 64])).collect();
        assert!(others.iter().all(|other| known != Identity::of(other)));
    }
}
