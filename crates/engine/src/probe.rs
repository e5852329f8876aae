//! A look at what passes between layers.

/// Receives intermediates by the names of the network's parts (`enc_block3`, `dec1_block0`, `head2.act1` …).
///
/// Tokens come as `[tokens, channels]`, maps as `[height, width, channels]`. Without a probe nothing is
/// computed or kept for it.
pub trait Probe {
    /// Called once for each intermediate.
    fn see(&mut self, name: &str, shape: &[usize], values: &[f32]);
}

/// A probe or none.
pub(crate) struct Watch<'a>(pub Option<&'a mut dyn Probe>);

impl Watch<'_> {
    pub(crate) fn see(&mut self, name: impl FnOnce() -> String, shape: &[usize], values: &[f32]) {
        if let Some(probe) = self.0.as_deref_mut() {
            probe.see(&name(), shape, values);
        }
    }

    pub(crate) fn is_on(&self) -> bool {
        self.0.is_some()
    }
}
