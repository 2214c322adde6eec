// A robot in another vendor's DDS: Fast DDS with ROS 2's names, and bytes that the test made.
//
// Publishes what is in the given files again and again: odometry and scans as they come, mounts and
// a costmap filter with its mask once and for all. Sends every command it hears back on /heard. It ends when its input does.
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

using Bytes = std::vector<uint8_t>;

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

struct Echo : DataReaderListener {
  DataWriter* out = nullptr;
  void on_data_available(DataReader* reader) override {
    Bytes bytes;
    SampleInfo info;
    while (reader->take_next_sample(&bytes, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) out->write(&bytes);
  }
};

static Bytes file(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

int main(int, char** arguments) {
  const int domain = std::atoi(arguments[1]);
  const std::string folder = arguments[2];
  DomainParticipantQos own;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  own.transport().use_builtin_transports = false;
  own.transport().user_transports.push_back(udp);
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(domain, own);
  auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto* subscriber = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT);

  auto topic = [&](const char* name, const char* type) {
    TypeSupport support(new Carried(type));
    support.register_type(participant);
    return participant->create_topic(name, support.get_type_name(), TOPIC_QOS_DEFAULT);
  };
  auto writer = [&](Topic* on, bool reliable, bool lasting) {
    DataWriterQos qos = DATAWRITER_QOS_DEFAULT;
    qos.reliability().kind = reliable ? RELIABLE_RELIABILITY_QOS : BEST_EFFORT_RELIABILITY_QOS;
    qos.durability().kind = lasting ? TRANSIENT_LOCAL_DURABILITY_QOS : VOLATILE_DURABILITY_QOS;
    qos.history().depth = 5;
    qos.endpoint().history_memory_policy =
        eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    return publisher->create_datawriter(on, qos);
  };
  auto* odometry = writer(topic("rt/odom", "nav_msgs::msg::dds_::Odometry_"), true, false);
  auto* scans = writer(topic("rt/scan", "sensor_msgs::msg::dds_::LaserScan_"), false, false);
  auto* mounts = writer(topic("rt/tf_static", "tf2_msgs::msg::dds_::TFMessage_"), true, true);
  auto* filter = writer(
      topic("rt/costmap_filter_info", "nav2_msgs::msg::dds_::CostmapFilterInfo_"), true, true);
  auto* mask = writer(topic("rt/filter_mask", "nav_msgs::msg::dds_::OccupancyGrid_"), true, true);
  Echo echo;
  echo.out = writer(topic("rt/heard", "geometry_msgs::msg::dds_::Twist_"), true, false);
  DataReaderQos qos = DATAREADER_QOS_DEFAULT;
  qos.reliability().kind = RELIABLE_RELIABILITY_QOS;
  qos.endpoint().history_memory_policy =
      eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  subscriber->create_datareader(topic("rt/cmd_vel", "geometry_msgs::msg::dds_::Twist_"), qos, &echo);

  auto* rubbish = writer(topic("rt/rubbish", "geometry_msgs::msg::dds_::Twist_"), true, false);
  Bytes none = file(folder + "/rubbish");
  Bytes turn = file(folder + "/scan"), place = file(folder + "/odom"), where = file(folder + "/tf");
  Bytes purpose = file(folder + "/info"), zones = file(folder + "/mask");
  mounts->write(&where);
  filter->write(&purpose);
  mask->write(&zones);
  std::atomic<bool> over{false};
  std::thread input([&] {
    while (std::cin.get() != EOF) {}
    over = true;
  });
  std::cout << "ready" << std::endl;
  for (int k = 0; !over; ++k) {
    odometry->write(&place);
    rubbish->write(&none);
    if (k % 5 == 0) scans->write(&turn);
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  input.join();
  participant->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(participant);
}
