//! The network that methods need: loaded once for a run, each view encoded once for a pair.

use crate::Error;
use selenograph_predict::{EncodedView, PredictOptions, Predictor, Rule};
use selenograph_reconstruct::View;
use selenograph_reconstruct::evidence::FocalKnowledge;
use selenograph_reconstruct::learned::{LearnedInput, LearnedOptions};
use serde::{Deserialize, Serialize};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::{Mutex, PoisonError};

/// What tells a network's answers from another's.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkRecord {
    /// The checkpoint's file name.
    pub checkpoint: String,
    /// Its BLAKE3.
    pub blake3: String,
    /// Its family.
    pub family: String,
    /// Licence of the weights, where the file states it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub license: Option<String>,
    /// How it is run and matched.
    pub run: PredictOptions,
    /// How pose and points follow.
    pub geometry: LearnedOptions,
}

impl NetworkRecord {
    /// What it does where its own points are judged, in one line.
    pub fn settings(&self) -> String {
        format!(
            "{}; points are the network's, in its own unit; pose: essential matrix of its matches \
             (a start every {} px, {} px of border; refined), from its points where they do not tell; reference protocol: the 2000 best \
             matches within the central rows, five-point RANSAC",
            self.identity(),
            self.run.subsample_px,
            self.run.border_px,
        )
    }

    /// Which network it is and what it sees, in one line.
    pub fn identity(&self) -> String {
        let input = match self.run.input {
            Rule::Whole { max_side: Some(side), .. } => format!("the whole picture, at most {side} px"),
            Rule::Whole { max_side: None, .. } => "the whole picture".to_owned(),
            Rule::Published { size, .. } => format!("as published, {size} px, a square cropped to 4:3"),
        };
        format!(
            "{} `{}` (BLAKE3 {}, licence: {}); input: {input}",
            self.family,
            self.checkpoint,
            self.blake3.get(..12).unwrap_or(&self.blake3),
            self.license.as_deref().unwrap_or("not stated"),
        )
    }
}

/// A network that is loaded.
pub struct Network {
    predictor: Predictor,
    record: NetworkRecord,
    /// One pair at a time: each takes all threads and a lot of memory.
    gate: Mutex<()>,
}

impl Network {
    /// A network and the checksum of its file.
    pub fn new(predictor: Predictor, blake3: String) -> Self {
        let about = predictor.about();
        let record = NetworkRecord {
            checkpoint: about.checkpoint.clone(),
            blake3,
            family: about.family.to_owned(),
            license: about.license.clone(),
            run: predictor.options().clone(),
            geometry: LearnedOptions::default(),
        };
        Self { predictor, record, gate: Mutex::new(()) }
    }

    /// What tells its answers from another's.
    pub fn record(&self) -> &NetworkRecord {
        &self.record
    }
}

/// A network at work on one pair.
pub struct Session<'a> {
    network: &'a Network,
    /// By light and view.
    encoded: RefCell<BTreeMap<(u64, usize), EncodedView>>,
    /// The lights of the last item, and what was said of it.
    last: RefCell<Option<([u64; 2], Rc<LearnedInput>)>>,
}

impl<'a> Session<'a> {
    /// How pose and points follow from what it says.
    pub(super) fn geometry(&self) -> &LearnedOptions {
        &self.network.record.geometry
    }

    /// With nothing encoded yet.
    pub fn new(network: &'a Network) -> Self {
        Self { network, encoded: RefCell::default(), last: RefCell::default() }
    }

    /// What the network says of the views under two lights; that of the last item is at hand, and a view that was seen under its
    /// light before is not encoded again.
    pub(super) fn said(&self, views: &[View; 2], lights: [u64; 2]) -> Result<Rc<LearnedInput>, Error> {
        if let Some((of, said)) = &*self.last.borrow()
            && *of == lights
        {
            return Ok(said.clone());
        }
        let Network { predictor, gate, .. } = self.network;
        let _one_at_a_time = gate.lock().unwrap_or_else(PoisonError::into_inner);
        let mut encoded = self.encoded.borrow_mut();
        let keys = [0, 1].map(|k| (lights[k], k));
        let new: Vec<usize> = (0..2).filter(|k| !encoded.contains_key(&keys[*k])).collect();
        let unseen: Vec<&View> = new.iter().map(|k| &views[*k]).collect();
        for (k, view) in new.into_iter().zip(predictor.encode(&unseen, &mut |_| {})?) {
            encoded.insert(keys[k], view);
        }
        let said =
            predictor.predict_encoded(keys.map(|key| &encoded[&key]), FocalKnowledge::Known, &mut |_| {})?;
        let said = Rc::new(said.input);
        *self.last.borrow_mut() = Some((lights, said.clone()));
        Ok(said)
    }
}
