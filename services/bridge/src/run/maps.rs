//! Frames, class maps and collapsed maps of areas: of those that run here to who asks, of those that
//! this host follows into shared memory.

use super::{Bridge, refuse};
use crate::inbox::Arriving;
use crate::link::View;
use crate::maps::{CountsReader, MapReader, MapTeller};
use process::{Element, Failure, Publisher, Subscriber, Worker, monotonic_ns};
use protocol::carried::{
    COUNTS_PAGE_MAX, CarriedCounts, CarriedMap, Cells, ClassIds, MapContent, Planes,
};
use protocol::codec::{Encoded, decode, encode};
use protocol::frame::FrameHeader;
use protocol::grid::{ClassMapHeader, CollapsedMapHeader};
use protocol::site::{Area, Host, Site};
use protocol::topic;
use protocol::wire::{FLAG_END_OF_STREAM, Header};

/// An area that this host may run.
struct Told {
    /// Index of the area in the site.
    index: usize,
    area: Area,
    /// Open while somebody elsewhere wants them, as the two below.
    frames: Option<Subscriber<FrameHeader, u64>>,
    classes: Option<Subscriber<ClassMapHeader, u8>>,
    collapsed: Option<Subscriber<CollapsedMapHeader, u64>>,
    frame_teller: MapTeller<Planes>,
    class_teller: MapTeller<ClassIds>,
}

/// An area of another host that this one follows.
struct Followed {
    area: Area,
    frames: Publisher<FrameHeader, u64>,
    classes: Publisher<ClassMapHeader, u8>,
    collapsed: Publisher<CollapsedMapHeader, u64>,
    frame_reader: MapReader<Planes>,
    class_reader: MapReader<ClassIds>,
    counts_reader: CountsReader,
}

/// All of them.
pub(super) struct Maps {
    host: String,
    /// Names this run of the bridge.
    session: u64,
    told: Vec<Told>,
    followed: Vec<Followed>,
    maps_out: u64,
    maps_in: u64,
    refused: u64,
}

fn counts(area: &Area) -> usize {
    area.grid().cells() * area.class_names().len()
}

impl Maps {
    pub(super) fn open(worker: &Worker, site: &Site, me: &Host) -> Result<Self, Failure> {
        let (mut told, mut followed) = (Vec::new(), Vec::new());
        for (index, area) in site.areas.iter().enumerate() {
            let (id, grid) = (&area.id, area.grid());
            let (planes, ids) = (Planes::new(grid.cells()), ClassIds(vec![u8::MAX; grid.cells()]));
            if area.may_run_on(Some(&me.id)) {
                told.push(Told {
                    index,
                    area: area.clone(),
                    frames: None,
                    classes: None,
                    collapsed: None,
                    frame_teller: MapTeller::new(planes),
                    class_teller: MapTeller::new(ids),
                });
            } else if me.follows.contains(id) {
                let (bus, source) = (&worker.bus, index as u32);
                let classes = area.class_names().len();
                let collapsed = topic::collapsed(id, grid.cells(), classes);
                followed.push(Followed {
                    frames: bus.publisher(&topic::frame(id, grid.plane_words()), source)?,
                    classes: bus.publisher(&topic::classes(id, grid.cells()), source)?,
                    collapsed: bus.publisher(&collapsed, source)?,
                    frame_reader: MapReader::new(planes, Planes::SYMBOLS - 1),
                    class_reader: MapReader::new(ids, classes as u32),
                    counts_reader: CountsReader::new(counts(area)),
                    area: area.clone(),
                });
            }
        }
        let (host, session) = (me.id.clone(), process::wall_ns());
        let (maps_out, maps_in, refused) = (0, 0, 0);
        Ok(Self { host, session, told, followed, maps_out, maps_in, refused })
    }

    /// How many streams somebody elsewhere listens to.
    pub(super) fn wanted(&self) -> usize {
        let open = |told: &Told| {
            usize::from(told.frames.is_some())
                + usize::from(told.classes.is_some())
                + usize::from(told.collapsed.is_some())
        };
        self.told.iter().map(open).sum()
    }

    /// What the health says.
    pub(super) fn counts(&self) -> [(&'static str, u64); 4] {
        let missed = self.followed.iter().map(|followed| {
            let Followed { frame_reader, class_reader, counts_reader, .. } = followed;
            frame_reader.missed() + class_reader.missed() + counts_reader.incomplete()
        });
        [
            ("maps_out", self.maps_out),
            ("maps_in", self.maps_in),
            ("maps_lost", missed.sum()),
            ("maps_refused", self.refused),
        ]
    }
}

impl Bridge {
    /// Opens what is wanted elsewhere, and closes what is wanted no more.
    pub(super) fn open_wanted(&mut self, worker: &Worker) -> Result<(), Failure> {
        for ((index, view), is_wanted) in self.inbox.take_wanted() {
            let Some(told) = self.maps.told.iter_mut().find(|told| told.index == index) else {
                continue;
            };
            let (id, grid) = (&told.area.id, told.area.grid());
            match view {
                View::Frame => {
                    let topic = topic::frame(id, grid.plane_words());
                    told.frames = is_wanted.then(|| worker.bus.subscriber(&topic)).transpose()?;
                    told.frame_teller.want_key();
                }
                View::Classes => {
                    let topic = topic::classes(id, grid.cells());
                    told.classes = is_wanted.then(|| worker.bus.subscriber(&topic)).transpose()?;
                    told.class_teller.want_key();
                }
                View::Collapsed => {
                    let classes = told.area.class_names().len();
                    let topic = topic::collapsed(id, grid.cells(), classes);
                    told.collapsed =
                        is_wanted.then(|| worker.bus.subscriber(&topic)).transpose()?;
                }
            }
        }
        Ok(())
    }

    /// Frames and maps of the areas here, to who wants them.
    pub(super) fn send_maps(&mut self) -> Result<(), Failure> {
        let now_ns = monotonic_ns();
        let Self { maps: Maps { host, session, told, maps_out, .. }, link, .. } = self;
        for told in told {
            let head = |content, number, period_ns, said: crate::maps::Said| CarriedMap {
                host: host.clone(),
                area: told.area.id.clone(),
                content,
                session: *session,
                seq: said.seq,
                number,
                period_ns,
                lasers_present: 0,
                context: 0,
                classes: 0,
                columns: told.area.columns,
                rows: told.area.rows,
                is_key: said.is_key,
                codes: said.codes,
            };
            // At the end of a recording there is no map any more, and so no cells.
            let mut send = |view, map: CarriedMap, is_end: bool| {
                let end = || CarriedMap { columns: 0, rows: 0, codes: Vec::new(), ..map.clone() };
                let map = if is_end { end() } else { map };
                let sent = encode(&map).map(|bytes| link.send_view((told.index, view), bytes));
                *maps_out += u64::from(sent.is_ok());
                sent.is_ok()
            };
            let mut is_whole = true;
            while let Some(sample) = told.frames.as_mut().map_or(Ok(None), Subscriber::receive)? {
                let (header, is_end) = (*sample.header(), sample.is_end_of_stream());
                let said = told.frame_teller.say(now_ns, |planes| {
                    if !is_end {
                        planes.words.copy_from_slice(sample.payload());
                    }
                });
                let map = head(MapContent::Frame, header.number, header.period_ns, said);
                let map = CarriedMap { lasers_present: header.lasers_present, ..map };
                is_whole &= send(View::Frame, map, is_end);
            }
            while let Some(sample) = told.classes.as_mut().map_or(Ok(None), Subscriber::receive)? {
                let (header, is_end) = (*sample.header(), sample.is_end_of_stream());
                let said = told.class_teller.say(now_ns, |ids| {
                    if !is_end {
                        ids.0.copy_from_slice(sample.payload());
                    }
                });
                let map = head(MapContent::Classes, header.number, header.period_ns, said);
                let ClassMapHeader { lasers_present, context, classes, .. } = header;
                let map = CarriedMap { lasers_present, context, classes, ..map };
                is_whole &= send(View::Classes, map, is_end);
            }
            if !is_whole {
                told.frame_teller.want_key();
                told.class_teller.want_key();
            }
            while let Some(sample) =
                told.collapsed.as_mut().map_or(Ok(None), Subscriber::receive)?
            {
                let header = *sample.header();
                let head = CarriedCounts {
                    host: host.clone(),
                    area: told.area.id.clone(),
                    number: header.number,
                    period_ns: header.period_ns,
                    context: header.context,
                    classes: header.classes,
                    columns: header.columns,
                    rows: header.rows,
                    offset: 0,
                    runs: Vec::new(),
                };
                for offset in (0..sample.payload().len()).step_by(COUNTS_PAGE_MAX) {
                    if let Ok(bytes) = encode(&head.part(sample.payload(), offset)) {
                        link.send_view((told.index, View::Collapsed), bytes);
                    }
                }
                *maps_out += 1;
            }
        }
        Ok(())
    }

    /// What came of the areas that this host follows.
    pub(super) fn take_maps(&mut self, arrived: Arriving) -> Result<(), Failure> {
        for ((stream, view), messages) in arrived {
            for (host, bytes) in messages {
                match view {
                    View::Frame | View::Classes => self.take_map(stream, host, &bytes)?,
                    View::Collapsed => self.take_counts(stream, host, &bytes)?,
                }
            }
        }
        Ok(())
    }

    /// What is meant for a stream of this area, from this host; counted if it is not.
    fn decoded<M: Encoded>(
        &mut self,
        (stream, host): (usize, usize),
        bytes: &[u8],
        names: impl Fn(&M) -> (&str, &str),
    ) -> Option<M> {
        let followed = self.maps.followed.get(stream)?;
        let (host, area) = (self.hosts.get(host)?.id.clone(), followed.area.id.clone());
        match decode::<M>(bytes) {
            Ok(message) if names(&message) == (&host, &area) => Some(message),
            Ok(message) => {
                let (found_host, found_area) = names(&message);
                let found = format!("area {found_area} of {found_host}");
                self.misrouted(&format!("area {area} of {host}"), &found);
                None
            }
            Err(error) => {
                refuse(&mut self.maps.refused, &format!("area {area} of {host}"), &error);
                None
            }
        }
    }

    fn take_map(&mut self, stream: usize, host: usize, bytes: &[u8]) -> Result<(), Failure> {
        fn names_of(map: &CarriedMap) -> (&str, &str) {
            (&map.host, &map.area)
        }
        let Some(map) = self.decoded((stream, host), bytes, names_of) else { return Ok(()) };
        let Some(followed) = self.maps.followed.get_mut(stream) else { return Ok(()) };
        let taken = match check(&followed.area, &map) {
            Ok(()) => followed.take(host, &map)?,
            Err(reason) => Err(reason),
        };
        match taken {
            Ok(is_new) => self.maps.maps_in += u64::from(is_new),
            Err(reason) => refuse(&mut self.maps.refused, &map.area, &reason),
        }
        Ok(())
    }

    fn take_counts(&mut self, stream: usize, host: usize, bytes: &[u8]) -> Result<(), Failure> {
        fn names_of(part: &CarriedCounts) -> (&str, &str) {
            (&part.host, &part.area)
        }
        let Some(part) = self.decoded((stream, host), bytes, names_of) else { return Ok(()) };
        let Some(followed) = self.maps.followed.get_mut(stream) else { return Ok(()) };
        let area = &followed.area;
        let fits = part.counts() == counts(area)
            && (part.columns, part.rows) == (area.columns, area.rows)
            && part.period_ns == area.lattice().period_ns()
            && (part.context as usize) <= area.contexts.len();
        if !fits {
            let reason = "a collapsed map of another size, period or context than the area's: do both \
                          hosts have the same site file?";
            refuse(&mut self.maps.refused, &part.area, &reason);
            return Ok(());
        }
        if followed.counts_reader.take(host, &part) {
            let header = CollapsedMapHeader {
                number: part.number,
                period_ns: part.period_ns,
                context: part.context,
                classes: part.classes,
                columns: part.columns,
                rows: part.rows,
                ..CollapsedMapHeader::default()
            };
            followed.collapsed.send(header, followed.counts_reader.counts())?;
            self.maps.maps_in += 1;
        }
        Ok(())
    }

    /// Readers that came later have the last collapsed maps.
    pub(super) fn serve_late_readers(&mut self) {
        self.maps.followed.iter_mut().for_each(|followed| followed.collapsed.serve_late_readers());
    }
}

/// The map is one of the area.
fn check(area: &Area, map: &CarriedMap) -> Result<(), String> {
    let size = (map.columns, map.rows);
    if !map.is_end_of_stream() && size != (area.columns, area.rows) {
        return Err(format!(
            "{} x {} cells, expected {} x {}: do both hosts have the same site file?",
            map.columns, map.rows, area.columns, area.rows
        ));
    }
    let classes = area.class_names().len();
    let period_ns = area.lattice().period_ns();
    let is_of_area = map.is_end_of_stream()
        || map.period_ns == period_ns
            && (map.context as usize) <= area.contexts.len()
            && (map.content == MapContent::Frame || map.classes as usize == classes);
    is_of_area.then_some(()).ok_or_else(|| {
        format!(
            "a map of period {} ns, context {}, {} classes, expected {period_ns}, at most {}, {classes}: \
             do both hosts have the same site file?",
            map.period_ns,
            map.context,
            map.classes,
            area.contexts.len()
        )
    })
}

impl Followed {
    /// Takes a map of the area's size; true if it was handed on.
    fn take(&mut self, host: usize, map: &CarriedMap) -> Result<Result<bool, String>, Failure> {
        let (columns, rows) = (map.columns, map.rows);
        let CarriedMap { number, period_ns, lasers_present, context, classes, .. } = *map;
        match map.content {
            MapContent::Frame => {
                let header = FrameHeader {
                    number,
                    period_ns,
                    lasers_present,
                    columns,
                    rows,
                    ..FrameHeader::default()
                };
                hand_on(&mut self.frames, &mut self.frame_reader, (host, map), header, |p| &p.words)
            }
            MapContent::Classes => {
                let header = ClassMapHeader {
                    number,
                    period_ns,
                    lasers_present,
                    context,
                    classes,
                    columns,
                    rows,
                    ..ClassMapHeader::default()
                };
                hand_on(&mut self.classes, &mut self.class_reader, (host, map), header, |ids| {
                    &ids.0
                })
            }
        }
    }
}

/// Hands on what a host says of a stream, once its map is known; the end of a recording always.
fn hand_on<H: Header, E: Element, C: Cells>(
    publisher: &mut Publisher<H, E>,
    reader: &mut MapReader<C>,
    (host, said): (usize, &CarriedMap),
    mut header: H,
    payload: fn(&C) -> &[E],
) -> Result<Result<bool, String>, Failure> {
    if said.is_end_of_stream() {
        header.envelope_mut().flags = FLAG_END_OF_STREAM;
        publisher.send(header, &[])?;
        return Ok(Ok(true));
    }
    let taken = reader.take(host, said, monotonic_ns());
    if taken == Ok(true) {
        publisher.send(header, payload(reader.map()))?;
    }
    Ok(taken)
}
