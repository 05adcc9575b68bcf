//! Pipelines that are built in the background.
