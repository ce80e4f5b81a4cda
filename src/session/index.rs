//! The first walk over a log: who speaks on which channel, what the small messages say. Pictures
//! are only counted.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::UnitQuaternion;

use crate::diagnostics::RangeFact;
use crate::image::decode::{CameraResponse, describe, white_level};
use crate::image::{Container, EncodedImage, decode};
use crate::messages::{
    AltitudeCheck, Decoder, DepthSamples, FrameTransform, Kind, RadiometrySetting, attitude_frame,
    header,
};
use crate::recording::{Block, Channel, Contents, Damage, Entry, Message, Recording, Window};
use crate::units::Stamp;
use crate::vehicle::{Calibration, DvlFacts, Ping};

use crate::parallel::{Job, Threads};

/// A picture of a camera: all that is known without decoding it.
#[derive(Clone, Copy, Debug)]
pub struct FrameRef {
    /// its own time, or the log's where it has none
    pub stamp: Stamp,
    /// when it was recorded
    pub logged: Stamp,
    /// where it lies: which block of the log, which of its entries
    pub place: (u32, u32),
}

/// What one channel said.
#[derive(Default)]
pub struct ChannelScan {
    /// messages
    pub count: u64,
    /// messages that contradict their schema, and the first complaint
    pub unreadable: (u64, Option<String>),
    /// frame id of the first message
    pub frame_id: String,
    /// one line on what it carries
    pub description: String,
    /// median of header time − log time, once the scan is done [s]
    pub clock_offset_s: Option<f64>,
    pub(super) offsets: Vec<f64>,
    /// messages without a stamp, or with one of 0
    pub unstamped: u64,
    /// the first message has been looked at
    pub(super) shape_asked: bool,
    /// pictures
    pub frames: Vec<FrameRef>,
    /// codes of 16-bit pictures or-ed together
    pub bits_used: u16,
    /// bytes of the largest picture's message
    pub largest_picture: usize,
    /// the first picture's size and container
    pub picture: Option<(usize, usize)>,
    /// whether pictures are PNG, JPEG or raw
    pub container: Option<Container>,
    /// pings with the log time
    pub pings: Vec<(Ping, Stamp)>,
    /// what the decoder mended or assumed, each once
    pub notes: Vec<RangeFact>,
    /// depth pictures: what becomes beams of the ping of the same number
    pub depths: Vec<DepthSamples>,
    /// the codec, where the channel holds video
    pub video: Option<String>,
    /// altitudes held against ranges
    pub heights: Vec<AltitudeCheck>,
    /// attitudes with the log time
    pub attitudes: Vec<(Stamp, Stamp, UnitQuaternion<f64>)>,
    /// settings of camera or strobe, by name
    pub settings: Vec<(Stamp, Vec<RadiometrySetting>)>,
    /// messages that say they have no attitude
    pub without_attitude: u64,
    /// the first calibration that is one, and whether any said "not calibrated"
    pub camera: Option<Calibration>,
    /// TF edges, first of each child
    pub edges: Vec<FrameTransform>,
}

/// What a log holds.
pub struct Scan {
    /// channels by id
    pub channels: BTreeMap<u16, ChannelScan>,
    /// decoders by channel id
    pub decoders: BTreeMap<u16, Decoder>,
    /// what could not be read
    pub damage: Vec<Damage>,
    /// messages in the window
    pub messages: u64,
    /// first and last log time in the window [ns]
    pub span: Option<(u64, u64)>,
    /// messages whose channel is nowhere declared
    pub homeless: u64,
    /// the stretch that was walked
    pub window: Window,
}

/// Decoders for the channels known so far; complaints about schemas that cannot be parsed.
fn decoder(
    recording: &Recording,
    channel: &Channel,
    dvl: &DvlFacts,
) -> Result<Option<Decoder>, String> {
    let schema = recording.schemas.get(&channel.schema_id);
    if dvl.path.is_some() && dvl.topic.as_ref() == Some(&channel.topic) {
        let (name, encoding, data) =
            schema.map_or(("", "", &[][..]), |s| (&s.name, &s.encoding, &s.data));
        return Decoder::by_path(&channel.message_encoding, name, encoding, data).map(Some);
    }
    match schema {
        Some(schema) => Decoder::for_channel(
            &channel.topic,
            &channel.message_encoding,
            &schema.name,
            &schema.encoding,
            &schema.data,
        ),
        None => Ok(None),
    }
}

/// Pictures looked at for the sensor's bit depth: the first few, then ever fewer.
fn is_probed(index: usize) -> bool {
    index < 3 || index.is_power_of_two()
}

/// Attitudes nearer than this tell no more of a vehicle, and hours at hundreds a second would fill
/// memory [s].
const ATTITUDES_APART_S: f64 = 0.015;

/// Blocks under way, for each core [byte].
const UNDER_WAY: usize = 16 << 20;

/// Walks the log once. Mounts and calibrations are taken from all of it, the rest from the window:
/// outside of it, only blocks are read that may hold them.
///
/// # Errors
/// The file cannot be read.
pub fn scan(
    recording: &Recording,
    window: Window,
    dvl: &DvlFacts,
    threads: &Threads,
) -> crate::error::Result<Scan> {
    let mut scan = Scan {
        channels: BTreeMap::new(),
        decoders: BTreeMap::new(),
        damage: recording.damage.clone(),
        messages: 0,
        span: None,
        homeless: 0,
        window,
    };
    for (id, channel) in &recording.channels {
        let mut of_channel = ChannelScan::default();
        match decoder(recording, channel, dvl) {
            Ok(Some(decoder)) => {
                scan.decoders.insert(*id, decoder);
            }
            Ok(None) => {}
            Err(e) => of_channel.unreadable.1 = Some(e),
        }
        scan.channels.insert(*id, of_channel);
    }
    let wanted = wanted_blocks(recording, window);
    let read = |(number, block): (u32, &Block)| Ok((number, recording.read(block, Window::ALL)?));
    let under_way = threads.count() * UNDER_WAY;
    threads.scope(|scope| {
        let blocks = wanted.into_iter().map(|(number, block)| {
            (block.memory_bytes().min(under_way / 2), Job::Work((number, block)))
        });
        scope.in_order(blocks, under_way, &read).try_for_each(|block| -> crate::error::Result<()> {
            let (number, Contents { entries, .. }) = block?;
            for (place, entry) in (0..).zip(entries) {
                match entry {
                    Entry::Message(message) => {
                        if let Some(channel) = recording.channels.get(&message.channel) {
                            scan.know(channel, &message);
                        }
                        scan.take(&message, (number, place), window, dvl);
                    }
                    Entry::Damaged(damage) => scan.damage.push(damage),
                }
            }
            Ok(())
        })
    })?;
    scan.damage.sort();
    scan.damage.dedup();
    for channel in scan.channels.values_mut() {
        if !channel.offsets.is_empty() {
            let middle = channel.offsets.len() / 2;
            channel.clock_offset_s =
                Some(*channel.offsets.select_nth_unstable_by(middle, f64::total_cmp).1);
            channel.offsets = Vec::new();
        }
    }
    Ok(scan)
}

/// Blocks that a scan reads: those of the window; outside of it the first of every channel, which
/// says what the channel carries, and all with latched mounts.
fn wanted_blocks(recording: &Recording, window: Window) -> Vec<(u32, &Block)> {
    let mut met: BTreeSet<u16> = BTreeSet::new();
    let is_latched =
        |id: &u16| recording.channels.get(id).is_some_and(|c| c.topic.ends_with("tf_static"));
    let mut wanted = |(_, block): &(u32, &Block)| match block.channels() {
        None => true,
        Some(channels) => {
            let first = channels.iter().filter(|id| met.insert(**id)).count() > 0;
            first || channels.iter().any(is_latched) || block.may_overlap(window)
        }
    };
    (0..).zip(recording.blocks()).filter(|block| wanted(block)).collect()
}

impl Scan {
    /// Drops what the sensors said, once a survey has taken what it needs: it grows with the log.
    pub fn forget_readings(&mut self) {
        for channel in self.channels.values_mut() {
            (channel.pings, channel.depths, channel.heights, channel.attitudes) =
                Default::default();
        }
    }

    /// Messages of no declared channel, as the loss they are.
    pub fn homeless_damage(&self) -> Option<Damage> {
        let reason = format!("{} messages belong to no channel and are left out", self.homeless);
        (self.homeless > 0).then_some(Damage { offset: 0, start_ns: 0, end_ns: 0, reason })
    }

    /// What only the channel's first message can say: JSON without a schema, depth in the shape of
    /// a picture.
    fn know(&mut self, channel: &Channel, message: &Message) {
        let Some(of_channel) = self.channels.get_mut(&message.channel).filter(|c| !c.shape_asked)
        else {
            return;
        };
        of_channel.shape_asked = true;
        if let Some(decoder) = self.decoders.get_mut(&message.channel) {
            decoder.refine(&channel.topic, message.data());
        } else if channel.schema_id == 0 && channel.message_encoding == "json" {
            match Decoder::for_json(&channel.topic, message.data()) {
                Ok(Some(decoder)) => {
                    self.decoders.insert(message.channel, decoder);
                }
                Ok(None) => {}
                Err(e) => of_channel.unreadable.1 = Some(e),
            }
        }
    }

    fn take(&mut self, message: &Message, place: (u32, u32), window: Window, dvl: &DvlFacts) {
        let inside = window.contains(message.log_time);
        let Some(channel) = self.channels.get_mut(&message.channel) else {
            self.homeless += u64::from(inside);
            return;
        };
        if inside {
            self.messages += 1;
            channel.count += 1;
            let (first, last) = self.span.unwrap_or((message.log_time, message.log_time));
            self.span = Some((first.min(message.log_time), last.max(message.log_time)));
        }
        let Some(decoder) = self.decoders.get(&message.channel) else { return };
        let kind = decoder.message_type.kind;
        if !inside && !matches!(kind, Kind::Transforms(_) | Kind::CameraInfo(_)) {
            return;
        }
        if let Err(complaint) = channel.read(decoder, kind, message, place, dvl) {
            // A picture that cannot be read is still a frame: both passes count it.
            if matches!(kind, Kind::Image(_)) {
                channel.frames.push(FrameRef {
                    stamp: message.log_stamp(),
                    logged: message.log_stamp(),
                    place,
                });
            }
            channel.unreadable.0 += 1;
            channel.unreadable.1.get_or_insert(complaint);
        }
    }
}

impl ChannelScan {
    fn read(
        &mut self,
        decoder: &Decoder,
        kind: Kind,
        message: &Message,
        place: (u32, u32),
        dvl: &DvlFacts,
    ) -> Result<(), String> {
        let value = decoder.read(message.data())?;
        let said = header(&value);
        let logged = message.log_stamp();
        let stamp = said.stamp.unwrap_or(logged);
        match said.stamp {
            Some(stamp) => self.offsets.push(stamp.seconds_since(logged)),
            None => self.unstamped += 1,
        }
        if self.frame_id.is_empty() {
            self.frame_id = if matches!(kind, Kind::Attitude(_)) {
                attitude_frame(&value)
            } else {
                said.frame_id
            };
        }
        match kind {
            Kind::Image(decode) => {
                self.largest_picture = self.largest_picture.max(message.data().len());
                let picture = decode(&value)?;
                if let EncodedImage::Video { codec } = picture {
                    self.video.get_or_insert_with(|| codec.into());
                }
                self.probe(&picture);
                self.frames.push(FrameRef { stamp, logged, place });
            }
            Kind::CameraInfo(decode) => {
                if self.camera.is_none() {
                    self.camera = decode(&value)?;
                }
            }
            Kind::Transforms(decode) => {
                for edge in decode(&value)? {
                    if self.edges.iter().all(|known| known.child != edge.child) {
                        self.edges.push(edge);
                    }
                }
            }
            Kind::Attitude(decode) => match decode(&value)? {
                Some(rotation) => {
                    // By both times: stamps may stand still, and messages be logged in bursts.
                    let near = |from: Stamp, to: Stamp| {
                        (0.0..ATTITUDES_APART_S).contains(&to.seconds_since(from))
                    };
                    if !self
                        .attitudes
                        .last()
                        .is_some_and(|(s, l, _)| near(*s, stamp) && near(*l, logged))
                    {
                        self.attitudes.push((stamp, logged, rotation));
                    }
                }
                None => self.without_attitude += 1,
            },
            Kind::Radiometry(decode) => self.settings.push((stamp, decode(&value)?)),
            Kind::Ping(_, decode) => {
                let reading = decode(&value, dvl)?;
                self.heights.extend(reading.altitude_check);
                if let Some(note) = reading.note
                    && !self.notes.contains(&note)
                {
                    self.notes.push(note);
                }
                if let Some(mut ping) = reading.ping {
                    ping.stamp = stamp;
                    self.pings.push((ping, logged));
                    self.depths.extend(reading.depth);
                }
            }
        }
        Ok(())
    }

    fn probe(&mut self, picture: &EncodedImage<'_>) {
        if self.frames.is_empty() {
            self.description = describe(picture);
            self.picture = decode::size(picture);
        }
        if is_probed(self.frames.len())
            && let Ok(decoded) = decode::decode(picture, CameraResponse::default())
        {
            self.container.get_or_insert(decoded.coding.container);
            if decoded.coding.bits == 16 {
                self.bits_used |= decoded.coding.bits_used;
            }
        }
    }

    /// Full scale of 16-bit pictures, from the bits they use; `None` for 8-bit ones.
    pub fn white_level(&self) -> Option<u16> {
        (self.bits_used != 0).then(|| white_level(self.bits_used))
    }

    /// Pings with at least three returns, at least one, and any altitude.
    pub fn ping_counts(&self) -> (usize, usize, usize) {
        let count = |f: &dyn Fn(&Ping) -> bool| self.pings.iter().filter(|(p, _)| f(p)).count();
        (
            count(&|p| p.returns() >= 3),
            count(&|p| p.returns() >= 1),
            count(&|p| p.altitude.is_some()),
        )
    }
}
