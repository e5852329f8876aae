//! Self-contained HTML pages, SVG plots and pictures. Knows nothing of the field: what is shown comes in as values.
#![forbid(unsafe_code)]
