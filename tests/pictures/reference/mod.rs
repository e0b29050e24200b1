//! The judges, judged: by closed forms, by each other, and what they say of the renderers.

mod closed;
mod convergence;
mod model;
mod renderer;
mod scenes;
mod volume;
