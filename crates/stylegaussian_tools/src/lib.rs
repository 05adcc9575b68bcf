//! Offline tools of StyleGaussian, as a library: embed, train, stylize and render scenes.

pub mod teacher;
