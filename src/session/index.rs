//! Recording → index: what a log holds, from one scan of it. Images are counted, not decoded;
//! what the sensors measured is kept apart, in [`Readings`], and dropped after the survey.

use std::collections::{BTreeMap, BTreeSet};

use super::joints::{self, Joint};
use super::readings::{ChannelReadings, Readings};
use crate::diagnostics::RangeFact;
use crate::image::decode::{CameraResponse, describe, white_level};
use crate::image::{Container, EncodedImage, decode, jpeg_header};
use crate::messages::value::Value;
use crate::messages::{ChannelSchema, Decoder, Kind, attitude_frame, header};
use crate::parallel::{Job, Threads};
use crate::recording::{
    Block, Channel, Damage, Entry, Fingerprint, FrameId, Message, Recording, Window,
};
use crate::stats;
use crate::units::Stamp;
use crate::vehicle::{CameraInfo, DvlFacts};

/// A frame of a camera: all that is known without decoding it.
#[derive(Clone, Copy, Debug)]
pub struct FrameRef {
    /// its identity
    pub id: FrameId,
    /// the header's time, or the log time where it has none
    pub stamp: Stamp,
    /// the log time
    pub logged: Stamp,
}

/// What one channel holds.
#[derive(Default)]
pub struct ChannelIndex {
    /// number of messages in the window
    pub count: u64,
    /// number of messages that contradict their schema, and the first reason
    pub unreadable: (u64, Option<String>),
    /// name of the schema whose known definition is used, as the log has none
    pub known_schema: Option<String>,
    /// frame id of the first message
    pub frame_id: String,
    /// image encoding and size, in one line
    pub description: String,
    /// median of header time − log time (s)
    pub clock_offset_s: Option<f64>,
    /// number of messages without a stamp, or with one of 0
    pub unstamped: u64,
    /// images, in the order of the file
    pub frames: Vec<FrameRef>,
    /// bitwise or of the pixel values of 16-bit images
    pub bits_used: u16,
    /// bytes of the largest image message
    pub largest_image_bytes: usize,
    /// bytes of all image messages
    pub image_bytes: u64,
    /// highest quality of the JPEGs that were examined
    pub jpeg_quality: Option<u8>,
    /// width and height of the first image (px)
    pub image_size: Option<(usize, usize)>,
    /// why the first image that was examined and cannot be decoded cannot be
    pub undecodable: Option<String>,
    /// file format of the images
    pub container: Option<Container>,
    /// what the decoder mended or assumed, each once
    pub notes: Vec<RangeFact>,
    /// the codec, where the channel holds video
    pub video: Option<String>,
    /// the first calibration, or the first of a calibrated camera
    pub camera: Option<CameraInfo>,
    /// edges of the TF tree
    pub joints: Vec<Joint>,
}

/// What a log holds.
pub struct LogIndex {
    /// channels by id
    pub channels: BTreeMap<u16, ChannelIndex>,
    /// decoders by channel id
    pub decoders: BTreeMap<u16, Decoder>,
    /// what could not be read
    pub damage: Vec<Damage>,
    /// number of messages in the window
    pub messages: u64,
    /// first and last log time in the window (ns)
    pub span: Option<(u64, u64)>,
    /// number of messages whose channel is not declared
    pub undeclared: u64,
}

/// Bytes of blocks in flight, for each thread.
const IN_FLIGHT: usize = 16 << 20;

/// Scans a log. Mounts and calibrations are taken from all of it, everything else from the window:
/// outside of it, only blocks are read that may hold them.
///
/// # Errors
/// The file cannot be read.
pub fn scan(
    recording: &Recording,
    window: Window,
    dvl: &DvlFacts,
    threads: &Threads,
) -> crate::error::Result<(LogIndex, Readings)> {
    scan_with(recording, window, dvl, None, threads)
}

/// As [`scan`]; the fingerprint takes the blocks that are read, and the rest of the log.
///
/// # Errors
/// The file cannot be read.
pub fn scan_with(
    recording: &Recording,
    window: Window,
    dvl: &DvlFacts,
    mut fingerprint: Option<Fingerprint<'_>>,
    threads: &Threads,
) -> crate::error::Result<(LogIndex, Readings)> {
    let mut scan = Scan::new(recording, window, dvl);
    let read = |block| recording.read(block, Window::ALL).map(|contents| (block, contents));
    let in_flight = threads.count() * IN_FLIGHT;
    threads.scope(|scope| {
        let blocks = needed_blocks(recording, window)
            .into_iter()
            .map(|block| (block.memory_bytes().min(in_flight / 2), Job::Work(block)));
        scope.in_order(blocks, in_flight, &read).try_for_each(|block| -> crate::error::Result<()> {
            let (block, contents) = block?;
            fingerprint.as_mut().map_or(Ok(()), |f| f.add(block, &contents))?;
            contents.entries.into_iter().for_each(|entry| scan.take(entry));
            Ok(())
        })
    })?;
    fingerprint.map_or(Ok(()), Fingerprint::finish)?;
    Ok(scan.finish())
}

/// Blocks that a scan reads: those of the window; outside of it the first of every channel, whose
/// message identifies the content, and all with latched mounts.
fn needed_blocks(recording: &Recording, window: Window) -> Vec<&Block> {
    let mut met: BTreeSet<u16> = BTreeSet::new();
    let is_latched =
        |id: &u16| recording.channels.get(id).is_some_and(|c| c.topic.ends_with("tf_static"));
    let mut is_needed = |block: &&Block| match block.channels() {
        None => true,
        Some(channels) => {
            let is_first = channels.iter().filter(|id| met.insert(**id)).count() > 0;
            is_first || channels.iter().any(is_latched) || block.may_overlap(window)
        }
    };
    recording.blocks().iter().filter(|block| is_needed(block)).collect()
}

/// The decoder of a channel; an error where its schema cannot be parsed.
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

/// A scan under way.
struct Scan<'s> {
    recording: &'s Recording,
    window: Window,
    dvl: &'s DvlFacts,
    index: LogIndex,
    readings: Readings,
    /// header time − log time of every stamped message, by channel (s)
    clock_offsets: BTreeMap<u16, Vec<f64>>,
    /// channels whose first message has been examined
    examined: BTreeSet<u16>,
}

impl<'s> Scan<'s> {
    fn new(recording: &'s Recording, window: Window, dvl: &'s DvlFacts) -> Self {
        let mut index = LogIndex {
            channels: BTreeMap::new(),
            decoders: BTreeMap::new(),
            damage: recording.damage.clone(),
            messages: 0,
            span: None,
            undeclared: 0,
        };
        for (id, channel) in &recording.channels {
            let mut of_channel = ChannelIndex::default();
            match decoder(recording, channel, dvl) {
                Ok(Some(decoder)) => {
                    index.decoders.insert(*id, decoder);
                }
                Ok(None) => {}
                Err(e) => of_channel.unreadable.1 = Some(e),
            }
            index.channels.insert(*id, of_channel);
        }
        let (readings, clock_offsets, examined) = Default::default();
        Self { recording, window, dvl, index, readings, clock_offsets, examined }
    }

    fn take(&mut self, entry: Entry) {
        match entry {
            Entry::Message(message) => {
                self.examine_first(&message);
                self.take_message(&message);
            }
            Entry::Damaged(damage) => self.index.damage.push(damage),
        }
    }

    /// Decoders that need a channel's first message: those of insufficient schemas, and depth in
    /// the shape of an image.
    fn examine_first(&mut self, message: &Message) {
        let Some(channel) = self.recording.channels.get(&message.channel) else { return };
        let Some(of_channel) = self.index.channels.get_mut(&message.channel) else { return };
        if !self.examined.insert(message.channel) {
            return;
        }
        if let Some(decoder) = self.index.decoders.get_mut(&message.channel) {
            decoder.refine(&channel.topic, message.data());
            return;
        }
        let schema = self.recording.schemas.get(&channel.schema_id);
        let (name, encoding, data) =
            schema.map_or(("", "", &[][..]), |s| (&s.name, &s.encoding, &s.data));
        let (topic, message_encoding) = (&channel.topic, &channel.message_encoding);
        let schema = ChannelSchema { topic, message_encoding, name, encoding, data };
        match Decoder::for_first_message(schema, message.data()) {
            Ok(Some((mut decoder, is_known))) => {
                decoder.refine(topic, message.data());
                self.index.decoders.insert(message.channel, decoder);
                of_channel.unreadable.1 = None;
                of_channel.known_schema = is_known.then(|| name.to_string());
            }
            Ok(None) => {}
            Err(e) => of_channel.unreadable.1 = Some(e),
        }
    }

    fn take_message(&mut self, message: &Message) {
        let is_inside = self.window.contains(message.log_time);
        let Some(channel) = self.index.channels.get_mut(&message.channel) else {
            self.index.undeclared += u64::from(is_inside);
            return;
        };
        if is_inside {
            self.index.messages += 1;
            channel.count += 1;
            let (first, last) = self.index.span.unwrap_or((message.log_time, message.log_time));
            self.index.span = Some((first.min(message.log_time), last.max(message.log_time)));
        }
        let Some(decoder) = self.index.decoders.get(&message.channel) else { return };
        let kind = decoder.message_type.kind;
        if !is_inside && !matches!(kind, Kind::Transforms(_) | Kind::CameraInfo(_)) {
            return;
        }
        let mut sink = ChannelSink {
            is_inside,
            index: channel,
            readings: self.readings.0.entry(message.channel).or_default(),
            clock_offsets: self.clock_offsets.entry(message.channel).or_default(),
        };
        if let Err(reason) = sink.read(decoder, message, self.dvl) {
            // An image that cannot be read is still a frame: both passes count it.
            if matches!(kind, Kind::Image(_)) {
                let logged = message.log_stamp();
                channel.frames.push(FrameRef { id: message.id, stamp: logged, logged });
            }
            channel.unreadable.0 += 1;
            channel.unreadable.1.get_or_insert(reason);
        }
    }

    fn finish(mut self) -> (LogIndex, Readings) {
        self.index.damage.sort();
        self.index.damage.dedup();
        for (id, offsets) in self.clock_offsets {
            if let (Some(channel), false) = (self.index.channels.get_mut(&id), offsets.is_empty()) {
                channel.clock_offset_s = Some(stats::median(&offsets));
            }
        }
        (self.index, self.readings)
    }
}

/// Images that are decoded to learn the bit depth of the sensor: the first few, then ever fewer.
fn is_probed(index: usize) -> bool {
    index < 3 || index.is_power_of_two()
}

/// Where the content of one channel goes.
struct ChannelSink<'s> {
    /// whether the message lies in the window
    is_inside: bool,
    index: &'s mut ChannelIndex,
    readings: &'s mut ChannelReadings,
    clock_offsets: &'s mut Vec<f64>,
}

impl ChannelSink<'_> {
    fn read(&mut self, decoder: &Decoder, message: &Message, dvl: &DvlFacts) -> Result<(), String> {
        let kind = decoder.message_type.kind;
        let value = decoder.read(message.data())?;
        let header = header(&value);
        let logged = message.log_stamp();
        let frame = FrameRef { id: message.id, stamp: header.stamp.unwrap_or(logged), logged };
        match header.stamp {
            Some(stamp) => self.clock_offsets.push(stamp.seconds_since(logged)),
            None => self.index.unstamped += 1,
        }
        if self.index.frame_id.is_empty() {
            self.index.frame_id = match kind {
                Kind::Attitude(_) => attitude_frame(&value),
                _ => header.frame_id,
            };
        }
        match kind {
            Kind::Image(decode) => {
                let bytes = message.data().len();
                self.index.largest_image_bytes = self.index.largest_image_bytes.max(bytes);
                self.index.image_bytes += bytes as u64;
                self.index.image(&decode(&value)?, frame);
            }
            Kind::CameraInfo(decode) => {
                if !self.index.camera.as_ref().is_some_and(CameraInfo::is_calibrated) {
                    let info = decode(&value)?;
                    if self.index.camera.is_none() || info.is_calibrated() {
                        self.index.camera = Some(info);
                    }
                }
            }
            Kind::Transforms(decode) => {
                let is_inside = self.is_inside;
                let edges = decode(&value)?.into_iter();
                edges.for_each(|edge| joints::add(&mut self.index.joints, edge, logged, is_inside));
            }
            Kind::Attitude(decode) => {
                self.readings.attitude(frame.stamp, logged, decode(&value)?);
            }
            Kind::Radiometry(decode) => {
                self.readings.settings.push((frame.stamp, decode(&value)?));
            }
            Kind::Ping(..) => self.ping(kind, &value, &frame, dvl)?,
        }
        Ok(())
    }

    fn ping(
        &mut self,
        kind: Kind,
        value: &Value<'_>,
        frame: &FrameRef,
        dvl: &DvlFacts,
    ) -> Result<(), String> {
        let Kind::Ping(_, decode) = kind else { return Ok(()) };
        let reading = decode(value, dvl)?;
        self.readings.altitude_checks.extend(reading.altitude_check);
        if let Some(note) = reading.note
            && !self.index.notes.contains(&note)
        {
            self.index.notes.push(note);
        }
        if let Some(mut ping) = reading.ping {
            ping.stamp = frame.stamp;
            self.readings.pings.push((ping, frame.logged));
            self.readings.depths.extend(reading.depth);
        }
        Ok(())
    }
}

impl ChannelIndex {
    fn image(&mut self, image: &EncodedImage<'_>, frame: FrameRef) {
        if let EncodedImage::Video { codec } = image {
            self.video.get_or_insert_with(|| (*codec).into());
        }
        if self.frames.is_empty() {
            self.description = describe(image);
            self.image_size = decode::size(image);
        }
        if is_probed(self.frames.len()) {
            match decode::decode(image, CameraResponse::default()) {
                Ok(decoded) => {
                    self.container.get_or_insert(decoded.coding.container);
                    if let EncodedImage::Compressed { data, .. } = image {
                        self.jpeg_quality = self.jpeg_quality.max(jpeg_header::quality(data));
                    }
                    if decoded.coding.bits == 16 {
                        self.bits_used |= decoded.coding.bits_used;
                    }
                }
                Err(reason) => drop(self.undecodable.get_or_insert(reason)),
            }
        }
        self.frames.push(frame);
    }

    /// Full scale of 16-bit images, from the bits they use (DN); `None` for 8-bit ones.
    pub fn white_level(&self) -> Option<u16> {
        (self.bits_used != 0).then(|| white_level(self.bits_used))
    }
}

impl LogIndex {
    /// Messages of undeclared channels, as damage.
    pub fn undeclared_damage(&self) -> Option<Damage> {
        let reason = format!("{} messages belong to no channel and are left out", self.undeclared);
        (self.undeclared > 0).then_some(Damage { offset: 0, start_ns: 0, end_ns: 0, reason })
    }
}
