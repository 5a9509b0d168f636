//! How many connections are kept, and which one is closed when a new one comes and there are too many.
//!
//! A new connection is always taken from the system at once: a health check must not wait behind connections that send nothing.
//! Its place comes from a connection that rests (it has sent no request yet, waits between two requests, or is only being read to
//! its end): first from the address that has most of them, there from the one that has rested longest. Where none rests, it comes
//! from one whose request came without a key. Connections that answer a request with a key are never closed for others: where
//! there are only those, the new connection is a spare one, whose requests are answered with 503, except on the health routes.

use std::collections::HashMap;
use std::net::{IpAddr, Ipv6Addr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tokio_util::task::task_tracker::TaskTrackerToken;

/// Connections beyond the bound that are only told 503; one more, and the oldest of these is closed.
const SPARE: usize = 64;

/// All connections of this process. Cheap to clone.
#[derive(Clone)]
pub struct Places(Arc<Shared>);

struct Shared {
    /// Most connections, without the spare ones.
    most: usize,
    /// Most connections, or requests through a trusted proxy, of one address.
    most_per_address: usize,
    table: Mutex<Table>,
}

#[derive(Default)]
struct Table {
    /// The number of the next connection: larger is younger.
    next: u64,
    connections: HashMap<u64, Arc<Connection>>,
    /// Requests at hand that came through a trusted proxy, by the address it named.
    forwarded: HashMap<IpAddr, usize>,
}

/// One connection, as the bounds see it.
pub struct Connection {
    number: u64,
    address: IpAddr,
    is_spare: bool,
    given_up: CancellationToken,
    state: Mutex<State>,
}

#[derive(Clone, Copy)]
struct State {
    /// Requests that are being answered.
    requests: usize,
    /// Of these, those that came with a key.
    with_key: usize,
    /// Whether there was a request yet.
    has_asked: bool,
    /// When the last request began or ended.
    since: Instant,
    /// Whether the last request came with a key.
    had_key: bool,
    /// Whether bytes of an answer wait until the client takes them.
    has_unsent: bool,
    is_given_up: bool,
}

/// Which connections may be closed for a new one, the first before the second.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Idle {
    /// The connection answers no request.
    Resting,
    /// The connection answers a request without a key.
    WithoutKey,
}

impl Places {
    /// At most this many connections, and this many of one address.
    pub fn new(most: usize, most_per_address: usize) -> Places {
        let (most, most_per_address) = (most.max(1), most_per_address.max(1));
        Places(Arc::new(Shared { most, most_per_address, table: Mutex::default() }))
    }

    /// A place for a new connection from `address`; another connection may be closed for it. Where the bound per address does
    /// not hold for it, it `is_bounded` by the number of all connections only.
    pub fn take(&self, address: IpAddr, is_bounded: bool) -> ConnectionPlace {
        let address = group(address);
        let mut table = self.0.table();
        let own = table.not_given_up().filter(|connection| connection.address == address).count();
        let is_crowded = is_bounded && own >= self.0.most_per_address;
        let mut is_spare = is_crowded && !table.make_room(|connection| connection.address == address);
        if !is_spare && table.not_given_up().count() >= self.0.most {
            is_spare = !table.make_room(|_| true);
        }
        if is_spare && table.connections.values().filter(|connection| connection.is_spare).count() >= SPARE {
            table.give_up_oldest_spare();
        }
        table.next += 1;
        let connection = Arc::new(Connection::new(table.next, address, is_spare));
        table.connections.insert(connection.number, Arc::clone(&connection));
        ConnectionPlace { connection, places: self.clone() }
    }

    /// Counts a request that a trusted proxy brings for `address`; `None` when that address has as many as it may.
    pub fn forwarded(&self, address: IpAddr) -> Option<Forwarded> {
        let address = group(address);
        let mut table = self.0.table();
        let count = table.forwarded.entry(address).or_default();
        if *count >= self.0.most_per_address {
            return None;
        }
        *count += 1;
        Some(Forwarded { address, places: self.clone() })
    }
}

impl Shared {
    fn table(&self) -> MutexGuard<'_, Table> {
        // Nothing is left half done in there.
        self.table.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Table {
    fn not_given_up(&self) -> impl Iterator<Item = &Arc<Connection>> {
        self.connections.values().filter(|connection| !connection.is_spare)
    }

    /// Closes one connection among those that `may` be closed; whether there was one.
    fn make_room(&mut self, may: impl Fn(&Connection) -> bool) -> bool {
        let mut per_address: HashMap<IpAddr, usize> = HashMap::new();
        for connection in self.not_given_up() {
            *per_address.entry(connection.address).or_default() += 1;
        }
        for idle in [Idle::Resting, Idle::WithoutKey] {
            let rank = |connection: &&Arc<Connection>| {
                let count = per_address.get(&connection.address).copied().unwrap_or(0);
                (std::cmp::Reverse(count), connection.state().since, connection.number)
            };
            let victim = self.not_given_up().filter(|c| may(c) && c.is_idle(idle)).min_by_key(rank).map(|c| c.number);
            if let Some(number) = victim
                && self.give_up(number, idle)
            {
                return true;
            }
        }
        false
    }

    fn give_up_oldest_spare(&mut self) {
        let oldest = self.connections.values().filter(|connection| connection.is_spare).map(|c| c.number).min();
        if let Some(connection) = oldest.and_then(|number| self.connections.remove(&number)) {
            connection.state().is_given_up = true;
            connection.given_up.cancel();
        }
    }

    /// Closes a connection, unless something has begun on it meanwhile.
    fn give_up(&mut self, number: u64, idle: Idle) -> bool {
        let Some(connection) = self.connections.get(&number) else { return false };
        let mut state = connection.state();
        if !state.is_idle(idle) {
            return false;
        }
        state.is_given_up = true;
        drop(state);
        connection.given_up.cancel();
        self.connections.remove(&number);
        true
    }
}

impl State {
    fn is_idle(&self, idle: Idle) -> bool {
        match idle {
            Idle::Resting => self.requests == 0 && !self.has_unsent,
            Idle::WithoutKey => self.with_key == 0 && !(self.has_unsent && self.had_key),
        }
    }
}

impl Connection {
    fn new(number: u64, address: IpAddr, is_spare: bool) -> Connection {
        let state = State {
            requests: 0,
            with_key: 0,
            has_asked: false,
            since: Instant::now(),
            had_key: false,
            has_unsent: false,
            is_given_up: false,
        };
        let (given_up, state) = (CancellationToken::new(), Mutex::new(state));
        Connection { number, address, is_spare, given_up, state }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_idle(&self, idle: Idle) -> bool {
        self.state().is_idle(idle)
    }

    /// Whether there was no place for the connection: only health routes are answered on it.
    pub fn is_spare(&self) -> bool {
        self.is_spare
    }

    /// Whether there was a request on it.
    pub fn has_asked(&self) -> bool {
        self.state().has_asked
    }

    /// Since when there is no request at hand; `None` while there is one.
    pub fn resting_since(&self) -> Option<Instant> {
        let state = self.state();
        state.is_idle(Idle::Resting).then_some(state.since)
    }

    /// Notes whether bytes of an answer wait until the client takes them.
    pub fn has_unsent(&self, has_unsent: bool) {
        self.state().has_unsent = has_unsent;
    }

    /// Resolves when its place is another's.
    pub async fn given_up(&self) {
        self.given_up.cancelled().await;
    }

    /// Notes that a request has begun, which a stopping service waits for by its `token`; `None` when the connection was given
    /// up a moment ago.
    pub fn begin(self: &Arc<Connection>, token: Option<TaskTrackerToken>) -> Option<AtHand> {
        let mut state = self.state();
        if state.is_given_up {
            return None;
        }
        state.requests += 1;
        state.has_asked = true;
        state.had_key = false;
        state.since = Instant::now();
        drop(state);
        let counted = Counted { connection: Arc::clone(self), has_key: AtomicBool::new(false), _token: token };
        Some(AtHand(Arc::new(counted)))
    }
}

/// A request that is being answered; when the last copy is dropped, it has been.
#[derive(Clone)]
pub struct AtHand(Arc<Counted>);

struct Counted {
    connection: Arc<Connection>,
    has_key: AtomicBool,
    _token: Option<TaskTrackerToken>,
}

impl AtHand {
    /// Marks a request with a valid API key, or from this machine where no keys are required: its connection is not closed in
    /// favour of another one.
    pub fn mark_with_key(&self) {
        if !self.0.has_key.swap(true, Ordering::Relaxed) {
            let mut state = self.0.connection.state();
            state.with_key += 1;
            state.had_key = true;
        }
    }

    /// Whether there was no place for the connection of the request: it is answered with 503, except on the health routes.
    pub fn is_spare(&self) -> bool {
        self.0.connection.is_spare
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        let mut state = self.connection.state();
        state.requests = state.requests.saturating_sub(1);
        state.with_key = state.with_key.saturating_sub(usize::from(*self.has_key.get_mut()));
        state.since = Instant::now();
    }
}

/// The place of one connection among the largest number of them; free again when dropped.
pub struct ConnectionPlace {
    connection: Arc<Connection>,
    places: Places,
}

impl ConnectionPlace {
    /// The connection that has it.
    pub fn connection(&self) -> &Arc<Connection> {
        &self.connection
    }
}

impl Drop for ConnectionPlace {
    fn drop(&mut self) {
        self.places.0.table().connections.remove(&self.connection.number);
    }
}

/// A request that a trusted proxy forwarded; counted until this is dropped.
pub struct Forwarded {
    address: IpAddr,
    places: Places,
}

impl Drop for Forwarded {
    fn drop(&mut self) {
        let mut table = self.places.0.table();
        let left = table.forwarded.get(&self.address).map_or(0, |count| count.saturating_sub(1));
        match left {
            0 => drop(table.forwarded.remove(&self.address)),
            left => drop(table.forwarded.insert(self.address, left)),
        }
    }
}

/// What counts as one address: of IPv6 its first 64 bits, which is what one customer of a provider has at least.
fn group(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V4(v4) => v4.into(),
        IpAddr::V6(v6) => Ipv6Addr::from_bits(v6.to_bits() & (u128::MAX << 64)).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(last: u8) -> IpAddr {
        [192, 0, 2, last].into()
    }

    fn is_given_up(place: &ConnectionPlace) -> bool {
        place.connection.given_up.is_cancelled()
    }

    #[test]
    fn the_address_with_most_resting_connections_gives_up_its_oldest() {
        let places = Places::new(4, 4);
        let honest = places.take(address(1), true);
        let slow: Vec<_> = (0..3).map(|_| places.take(address(2), true)).collect();
        let new = places.take(address(3), true);
        assert!(!new.connection.is_spare && !is_given_up(&honest), "an older one of an address with few stays");
        assert_eq!(slow.iter().map(is_given_up).collect::<Vec<_>>(), [true, false, false]);
    }

    #[test]
    fn a_request_with_a_key_keeps_its_place_and_one_without_does_not() {
        let places = Places::new(2, 2);
        let (first, second) = (places.take(address(1), true), places.take(address(2), true));
        let (keyed, open) = (first.connection.begin(None).unwrap(), second.connection.begin(None).unwrap());
        keyed.mark_with_key();
        let third = places.take(address(3), true);
        assert!(is_given_up(&second) && !is_given_up(&first) && !third.connection.is_spare);
        drop((open, second));
        let answering = third.connection.begin(None).unwrap();
        answering.mark_with_key();
        let spare = places.take(address(4), true);
        assert!(spare.connection.is_spare && !is_given_up(&first) && !is_given_up(&third));
        drop(keyed);
        assert!(!places.take(address(5), true).connection.is_spare && is_given_up(&first));
        assert!(first.connection.begin(None).is_none(), "it was given up a moment ago");
    }

    #[test]
    fn one_address_has_its_share_and_what_is_not_bounded_has_more() {
        let places = Places::new(10, 2);
        let at_hand = |place: &ConnectionPlace| {
            let request = place.connection.begin(None).unwrap();
            request.mark_with_key();
            request
        };
        let kept: Vec<_> = (0..2).map(|_| places.take(address(1), true)).collect();
        let requests: Vec<_> = kept.iter().map(at_hand).collect();
        assert!(places.take(address(1), true).connection.is_spare);
        assert!(!places.take(address(1), false).connection.is_spare, "a trusted proxy");
        assert!(!places.take(address(2), true).connection.is_spare, "another address");
        drop(requests);
        assert!(!places.take(address(1), true).connection.is_spare && is_given_up(&kept[0]));
        // 64 bits of IPv6 are one address, and IPv4 in its disguise is IPv4.
        let v6 = |text: &str| group(text.parse().unwrap());
        assert_eq!(v6("2001:db8:1:2:3:4:5:6"), v6("2001:db8:1:2::1"));
        assert_ne!(v6("2001:db8:1:2::1"), v6("2001:db8:1:3::1"));
        assert_eq!(v6("::ffff:192.0.2.1"), address(1));
    }

    #[test]
    fn spare_connections_are_bounded_too() {
        let places = Places::new(1, 1);
        let kept = places.take(address(1), true);
        let request = kept.connection.begin(None).unwrap();
        request.mark_with_key();
        let spare: Vec<_> = (0..=SPARE).map(|_| places.take(address(2), true)).collect();
        assert!(spare.iter().all(|place| place.connection.is_spare));
        assert_eq!(spare.iter().filter(|place| is_given_up(place)).count(), 1);
        assert!(is_given_up(&spare[0]) && !is_given_up(&kept));
    }

    #[test]
    fn requests_through_a_proxy_are_counted_for_whom_they_are_brought() {
        let places = Places::new(10, 2);
        let held = [places.forwarded(address(1)).unwrap(), places.forwarded(address(1)).unwrap()];
        assert!(places.forwarded(address(1)).is_none() && places.forwarded(address(2)).is_some());
        drop(held);
        assert!(places.forwarded(address(1)).is_some());
    }
}
