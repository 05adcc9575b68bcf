//! From colors to the layers that an entity shows: transitions, volumes.

pub(crate) mod compose;
pub(crate) mod place;
pub(crate) mod sun;
pub(crate) mod transition;
pub(crate) mod volume;
pub(crate) mod worn;
