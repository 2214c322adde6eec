// A robot and its controller in another vendor's DDS: Fast DDS with ROS 2's names, Fast CDR's bytes.
//
// The robot stands in a room, sends odometry, scans and mounts, and drives as it is commanded on
// /cmd_vel; each command it sends back on /heard. A costmap filter with its mask, and what is no
// message, it sends as the bytes that the test made. It obeys lines of text:
//   want V OMEGA | hush      the controller asks for that on /cmd_vel_nav, 50 times a second
//   fault NAME | fault none  `half` of all messages is lost; odometry stamped `tomorrow`
//   truth                    x, heading, speed, clearance, and the least one while it moved
//   graph                    every node with its topics, as `ros2 node info` finds them
// It ends when its input does.
#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/reader/ReaderDiscoveryInfo.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastdds/rtps/writer/WriterDiscoveryInfo.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <deque>
#include <fstream>
#include <iostream>
#include <iterator>
#include <map>
#include <mutex>
#include <random>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

using namespace eprosima::fastdds::dds;
using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;
using eprosima::fastrtps::rtps::GUID_t;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::ReaderDiscoveryInfo;
using eprosima::fastrtps::rtps::SerializedPayload_t;
using eprosima::fastrtps::rtps::WriterDiscoveryInfo;

using Bytes = std::vector<uint8_t>;
using Gid = std::array<uint8_t, 16>;
using Clock = std::chrono::steady_clock;

constexpr double STEP = 0.005;   // of the robot's motion [s]
constexpr int ODOMETRY = 4;      // steps from one to the next: 50 Hz
constexpr int SCAN = 20;         // 10 Hz
constexpr double PATIENCE = 0.5; // without a command for so long it brakes [s]

// Carries bytes, encapsulation header included, whatever they mean.
struct Carried : TopicDataType {
  explicit Carried(const std::string& name) {
    setName(name.c_str());
    m_typeSize = 1 << 16;
    m_isGetKeyDefined = false;
    auto_fill_type_object(false);
    auto_fill_type_information(false);
  }
  bool serialize(void* data, SerializedPayload_t* payload) override {
    const auto& bytes = *static_cast<Bytes*>(data);
    std::memcpy(payload->data, bytes.data(), bytes.size());
    payload->length = bytes.size();
    payload->encapsulation = CDR_LE;
    return true;
  }
  bool deserialize(SerializedPayload_t* payload, void* data) override {
    static_cast<Bytes*>(data)->assign(payload->data, payload->data + payload->length);
    return true;
  }
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return static_cast<uint32_t>(static_cast<Bytes*>(data)->size()); };
  }
  void* createData() override { return new Bytes; }
  void deleteData(void* data) override { delete static_cast<Bytes*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

// What `fill` writes, as a message.
template <typename Fill>
static Bytes message(Fill fill) {
  Bytes bytes(1 << 16);
  FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  fill(cdr);
  bytes.resize(cdr.getSerializedDataLength());
  return bytes;
}

// `read` reads a message; false where its bytes are none.
template <typename Read>
static bool understood(Bytes& bytes, Read read) {
  try {
    FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    cdr.read_encapsulation();
    read(cdr);
    return true;
  } catch (const eprosima::fastcdr::exception::Exception&) {
    return false;
  }
}

static void header(Cdr& cdr, const std::string& frame, int ahead = 0) {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const auto ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count();
  cdr << int32_t(ns / 1'000'000'000 + ahead) << uint32_t(ns % 1'000'000'000) << frame;
}

static void doubles(Cdr& cdr, std::initializer_list<double> values, int zeros = 0) {
  for (double value : values) cdr << value;
  while (zeros-- > 0) cdr << 0.0;
}

struct Twist { double v = 0.0, omega = 0.0; };

static Bytes twist(Twist t) {
  return message([t](Cdr& cdr) { doubles(cdr, {t.v, 0, 0, 0, 0, t.omega}); });
}

// What the test says of the robot and of the room around it [m, rad].
struct Given {
  double front, side, mount, beams, view, range, delay, acceleration, track;
  double left, right, far, near;  // the room: y < left, y > -right, x < far, x > -near
};

// A differential robot that does what it is told after its delay, as fast as it can accelerate.
class Robot {
 public:
  explicit Robot(Given given) : given_(given) {}
  void send(Twist t) { coming_.push_back({Clock::now(), t}); }
  void step() {
    const auto now = Clock::now();
    while (!coming_.empty() && std::chrono::duration<double>(now - coming_.front().first).count()
                                   >= given_.delay) {
      heard_ = coming_.front().first;
      wanted_ = coming_.front().second;
      coming_.pop_front();
    }
    if (std::chrono::duration<double>(now - heard_).count() > PATIENCE) wanted_ = {};
    const double dv = given_.acceleration * STEP, domega = 2.0 * dv / given_.track;
    twist.v += std::clamp(wanted_.v - twist.v, -dv, dv);
    twist.omega += std::clamp(wanted_.omega - twist.omega, -domega, domega);
    x += twist.v * STEP * std::cos(psi);
    y += twist.v * STEP * std::sin(psi);
    psi += twist.omega * STEP;
    if (std::abs(twist.v) + std::abs(twist.omega) > 1e-3) least = std::min(least, clearance());
  }
  double clearance() const {
    double nearest = INFINITY;
    for (double u : {given_.front, -given_.front})
      for (double w : {given_.side, -given_.side}) {
        const double px = x + u * std::cos(psi) - w * std::sin(psi);
        const double py = y + u * std::sin(psi) + w * std::cos(psi);
        nearest = std::min({nearest, given_.left - py, py + given_.right, given_.far - px,
                            px + given_.near});
      }
    return nearest;
  }
  Bytes odometry(int ahead) const {
    return message([this, ahead](Cdr& cdr) {
      header(cdr, "odom", ahead);
      cdr << std::string("base_link");
      doubles(cdr, {x, y, 0, 0, 0, std::sin(psi / 2), std::cos(psi / 2)}, 36);
      doubles(cdr, {twist.v, 0, 0, 0, 0, twist.omega}, 36);
    });
  }
  Bytes scan() {
    const int n = int(given_.beams);
    const double step = given_.view / (n - 1), first = -given_.view / 2;
    const double ox = x + given_.mount * std::cos(psi), oy = y + given_.mount * std::sin(psi);
    std::vector<float> ranges(n);
    for (int i = 0; i < n; ++i) {
      const double a = psi + first + step * i, c = std::cos(a), s = std::sin(a);
      const double along = c > 0 ? (given_.far - ox) / c : (-given_.near - ox) / c;
      const double across = s > 0 ? (given_.left - oy) / s : (-given_.right - oy) / s;
      const double range = std::min(along, across) + noise_(random_);
      ranges[i] = range < given_.range ? float(range) : INFINITY;
    }
    return message([&](Cdr& cdr) {
      header(cdr, "laser");
      for (double value : {first, -first, step, 0.0, 0.1, 0.05, given_.range}) cdr << float(value);
      cdr << ranges << std::vector<float>{};
    });
  }
  Bytes mounts() const {
    return message([this](Cdr& cdr) {
      cdr << uint32_t(1);
      header(cdr, "base_link");
      cdr << std::string("laser");
      doubles(cdr, {given_.mount, 0, 0.5, 0, 0, 0, 1});
    });
  }
  double x = 0, y = 0, psi = 0, least = INFINITY;
  Twist twist;

 private:
  const Given given_;
  Twist wanted_;
  Clock::time_point heard_ = Clock::now();
  std::deque<std::pair<Clock::time_point, Twist>> coming_;
  std::mt19937 random_{7};
  std::normal_distribution<double> noise_{0.0, 0.005};
};

// Which node has which topics: endpoints by discovery, names of nodes by ros_discovery_info.
class Graph : public DomainParticipantListener {
 public:
  void on_publisher_discovery(DomainParticipant*, WriterDiscoveryInfo&& i) override {
    end(i.info.guid(), i.status == WriterDiscoveryInfo::DISCOVERED_WRITER, "publishes", i.info);
  }
  void on_subscriber_discovery(DomainParticipant*, ReaderDiscoveryInfo&& i) override {
    end(i.info.guid(), i.status == ReaderDiscoveryInfo::DISCOVERED_READER, "subscribes", i.info);
  }
  void told(Bytes& bytes) {
    understood(bytes, [this](Cdr& cdr) {
      Gid who;
      uint32_t count;
      std::map<Gid, std::string> own;
      cdr >> who >> count;
      while (count--) {
        std::string space, name;
        cdr >> space >> name;
        for (int k = 0; k < 2; ++k) {
          uint32_t many;
          cdr >> many;
          while (many--) {
            Gid gid;
            cdr >> gid;
            own[gid] = (space == "/" ? "" : space) + "/" + name;
          }
        }
      }
      std::lock_guard<std::mutex> hold(lock_);
      nodes_[who] = own;
    });
  }
  // One line: entries "NODE publishes TOPIC TYPE reliable|best-effort volatile|lasting USERDATA".
  std::string text() {
    std::lock_guard<std::mutex> hold(lock_);
    std::string all;
    for (const auto& [participant, own] : nodes_)
      for (const auto& [gid, node] : own)
        if (ends_.count(gid)) all += node + " " + ends_[gid] + "|";
    return all;
  }

 private:
  static Gid gid(const GUID_t& guid) {
    Gid made;
    std::memcpy(made.data(), guid.guidPrefix.value, 12);
    std::memcpy(made.data() + 12, guid.entityId.value, 4);
    return made;
  }
  template <typename Info>
  void end(const GUID_t& guid, bool here, const std::string& does, const Info& info) {
    const auto& data = info.m_qos.m_userData.data_vec();
    std::lock_guard<std::mutex> hold(lock_);
    if (here)
      ends_[gid(guid)] = does + " " + info.topicName().to_string() + " " + info.typeName().to_string() +
          (info.m_qos.m_reliability.kind == RELIABLE_RELIABILITY_QOS ? " reliable" : " best-effort") +
          (info.m_qos.m_durability.kind == VOLATILE_DURABILITY_QOS ? " volatile " : " lasting ") +
          std::string(data.begin(), data.end());
    else
      ends_.erase(gid(guid));
  }
  std::mutex lock_;
  std::map<Gid, std::string> ends_;
  std::map<Gid, std::map<Gid, std::string>> nodes_;
};

// Calls for each message of a topic.
struct Heard : DataReaderListener {
  std::function<void(Bytes&)> call;
  void on_data_available(DataReader* reader) override {
    Bytes bytes;
    SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) call(bytes);
  }
};

static Bytes file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

int main(int, char** arguments) {
  const int domain = std::atoi(arguments[1]);
  const std::string folder = arguments[2];
  Given given;
  std::ifstream numbers(folder + "/robot");
  for (double* at : {&given.front, &given.side, &given.mount, &given.beams, &given.view,
                     &given.range, &given.delay, &given.acceleration, &given.track, &given.left,
                     &given.right, &given.far, &given.near})
    numbers >> *at;

  DomainParticipantQos own;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  own.transport().use_builtin_transports = false;
  own.transport().user_transports.push_back(udp);
  Graph graph;
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(
      domain, own, &graph, StatusMask::none());
  auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  const auto room = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;

  std::map<std::string, Topic*> topics;
  auto topic = [&](const std::string& name, const std::string& type) {
    if (!topics.count(name)) {
      TypeSupport support(new Carried(type));
      support.register_type(participant);
      topics[name] = participant->create_topic(name, support.get_type_name(), TOPIC_QOS_DEFAULT);
    }
    return topics[name];
  };
  auto writer = [&](Topic* on, bool reliable, bool lasting) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = lasting ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().depth = 5;
    qos.endpoint().history_memory_policy = room;
    return publisher->create_datawriter(on, qos);
  };
  auto reader = [&](Topic* on, bool lasting, Heard& heard) {
    DataReaderQos qos = DATAREADER_QOS_DEFAULT;
    qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
    qos.durability().kind = lasting ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().depth = lasting ? 100 : 5;
    qos.endpoint().history_memory_policy = room;
    subscriber->create_datareader(on, qos, &heard);
  };
  const std::string twists = "geometry_msgs::msg::dds_::Twist_";
  auto* odometry = writer(topic("rt/odom", "nav_msgs::msg::dds_::Odometry_"), true, false);
  auto* scans = writer(topic("rt/scan", "sensor_msgs::msg::dds_::LaserScan_"), false, false);
  auto* mounts = writer(topic("rt/tf_static", "tf2_msgs::msg::dds_::TFMessage_"), true, true);
  auto* purpose = writer(
      topic("rt/costmap_filter_info", "nav2_msgs::msg::dds_::CostmapFilterInfo_"), true, true);
  auto* mask = writer(topic("rt/filter_mask", "nav_msgs::msg::dds_::OccupancyGrid_"), true, true);
  auto* controller = writer(topic("rt/cmd_vel_nav", twists), true, false);
  auto* back = writer(topic("rt/heard", twists), true, false);
  auto* rubbish = writer(topic("rt/rubbish", twists), true, false);

  Robot robot(given);
  std::mutex lock;
  Heard commands, strict, nodes;
  commands.call = [&](Bytes& bytes) {
    Twist t;
    double other;
    if (!understood(bytes, [&](Cdr& cdr) { cdr >> t.v >> other >> other >> other >> other >> t.omega; }))
      return;
    std::lock_guard<std::mutex> hold(lock);
    robot.send(t);
    Bytes again = twist(t);
    back->write(&again);
  };
  strict.call = [](Bytes&) {};
  nodes.call = [&](Bytes& bytes) { graph.told(bytes); };
  reader(topic("rt/cmd_vel", twists), false, commands);
  reader(topic("rt/strict_cmd_vel", twists), true, strict);  // wants what no controller offers
  reader(topic("ros_discovery_info", "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"), true,
         nodes);

  Bytes none = file(folder + "/rubbish"), where = robot.mounts();
  Bytes info = file(folder + "/info"), zones = file(folder + "/mask");
  mounts->write(&where);
  purpose->write(&info);
  mask->write(&zones);

  bool over = false, asks = false;
  Twist wanted;
  std::string fault;
  std::thread input([&] {
    for (std::string line; std::getline(std::cin, line);) {
      std::istringstream words(line);
      std::string word;
      words >> word;
      std::lock_guard<std::mutex> hold(lock);
      if (word == "want") asks = bool(words >> wanted.v >> wanted.omega);
      if (word == "hush") asks = false;
      if (word == "fault") words >> fault;
      if (word == "truth")
        std::cout << robot.x << ' ' << robot.psi << ' ' << robot.twist.v << ' '
                  << robot.clearance() << ' ' << robot.least << std::endl;
      if (word == "graph") std::cout << graph.text() << std::endl;
    }
    std::lock_guard<std::mutex> hold(lock);
    over = true;
  });
  std::cout << "ready" << std::endl;
  auto due = Clock::now();
  for (long k = 0, sent = 0;; ++k) {
    {
      std::lock_guard<std::mutex> hold(lock);
      if (over) break;
      robot.step();
      auto send = [&](DataWriter* out, Bytes bytes) {
        if (fault != "half" || ++sent % 2) out->write(&bytes);
      };
      if (k % ODOMETRY == 0) {
        send(odometry, robot.odometry(fault == "tomorrow" ? 86'400 : 0));
        if (asks) send(controller, twist(wanted));
        rubbish->write(&none);
      }
      if (k % SCAN == 0) send(scans, robot.scan());
    }
    due += std::chrono::microseconds(long(1e6 * STEP));
    std::this_thread::sleep_until(due);
  }
  input.join();
  participant->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(participant);
}
