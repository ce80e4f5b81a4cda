//! Where each unknown of the joint solve stands: beam nodes, α (band by band, node by node in
//! time), exponent, strength of backscatter, places.

use super::{Row, Setting};
use crate::model::{Backscatter, SHAPES};
use crate::vehicle::MAX_LAMPS;

/// The most entries that a row has for one band: α 2, exponent 1, glow 3, places 6.
const MOST: usize = 12;

/// Non-zero entries of a row's design.
pub struct Entries<const N: usize> {
    list: [(usize, f64); N],
    count: usize,
}

impl<const N: usize> Entries<N> {
    fn new() -> Self {
        Self { list: [(0, 0.0); N], count: 0 }
    }

    fn put(&mut self, unknown: usize, value: f64) {
        self.list[self.count] = (unknown, value);
        self.count += 1;
    }
}

impl<const N: usize> std::ops::Deref for Entries<N> {
    type Target = [(usize, f64)];
    fn deref(&self) -> &[(usize, f64)] {
        &self.list[..self.count]
    }
}

/// The layout.
pub struct Columns {
    /// node → unknown, `usize::MAX` where it is none
    beam: Vec<usize>,
    beam_nodes: usize,
    bands: usize,
    time_nodes: usize,
    with_exponent: bool,
    with_glow: bool,
    /// how many places are unknowns now
    pub places: usize,
}

impl Columns {
    pub fn new(is_seen: impl Iterator<Item = bool>, setting: &Setting<'_>) -> Self {
        let mut beam_nodes = 0;
        let beam = is_seen.map(|seen| {
            beam_nodes += usize::from(seen);
            if seen { beam_nodes - 1 } else { usize::MAX }
        });
        Self {
            beam: beam.collect(),
            beam_nodes,
            bands: setting.bands,
            time_nodes: setting.drift.map_or(1, |d| d.nodes),
            with_exponent: setting.fit_exponent,
            with_glow: setting.glow.is_some(),
            places: 0,
        }
    }

    pub fn beam_nodes(&self) -> usize {
        self.beam_nodes
    }

    pub fn beam_node(&self, node: usize) -> Option<usize> {
        self.beam.get(node).copied().filter(|i| *i != usize::MAX)
    }

    pub fn attenuation(&self, band: usize, time: usize) -> usize {
        self.beam_nodes + band * self.time_nodes + time
    }

    fn after_attenuation(&self) -> usize {
        self.attenuation(self.bands, 0)
    }

    pub fn exponent(&self) -> Option<usize> {
        self.with_exponent.then(|| self.after_attenuation())
    }

    pub fn glow(&self, band: usize) -> Option<usize> {
        self.with_glow.then(|| self.glow_begins() + band)
    }

    /// Unknowns from here to the places are of what scatters back.
    pub fn glow_begins(&self) -> usize {
        self.after_attenuation() + usize::from(self.with_exponent)
    }

    pub fn shape(&self, term: usize) -> Option<usize> {
        self.glow(self.bands + term)
    }

    pub fn first_place(&self) -> usize {
        self.glow_begins() + if self.with_glow { self.bands + SHAPES } else { 0 }
    }

    pub fn count(&self) -> usize {
        self.first_place() + self.places
    }

    /// What a row's design has in all bands: the beam's nodes.
    pub fn of_beam(&self, row: &Row) -> Entries<{ 4 * MAX_LAMPS }> {
        let mut entries = Entries::new();
        for &(node, weight) in &row.nodes[..row.nodes_used] {
            if let Some(unknown) = self.beam_node(node) {
                entries.put(unknown, weight);
            }
        }
        entries
    }

    /// The rest of it, which is one band's own; all unknowns of the beam stand before these.
    pub fn of_band(
        &self,
        setting: &Setting<'_>,
        back: &Backscatter,
        row: &Row,
        band: usize,
    ) -> Entries<MOST> {
        let mut entries = Entries::new();
        match setting.drift {
            None => entries.put(self.attenuation(band, 0), -row.length_m),
            Some(drift) => {
                let (node, share) = drift.places[row.frame as usize];
                entries.put(self.attenuation(band, node), -row.length_m * (1.0 - share));
                if share > 0.0 {
                    entries.put(self.attenuation(band, node + 1), -row.length_m * share);
                }
            }
        }
        if let Some(unknown) = self.exponent() {
            entries.put(unknown, -row.log_strobe_leg);
        }
        if let Some(unknown) = self.glow(band) {
            entries.put(unknown, row.glow.of_band(band, &back.shape) * row.per_direct[band]);
        }
        if let Some(first) = self.shape(0) {
            let by_shape = row.glow.by_shape(band);
            by_shape.iter().enumerate().for_each(|(k, x)| {
                entries.put(first + k, x * back.strength_per_m[band] * row.per_direct[band])
            });
        }
        (0..self.places).for_each(|k| entries.put(self.first_place() + k, row.by_place[band][k]));
        entries
    }
}
