//! The pipeline against answers found elsewhere, through its public doors only.

mod rays;
