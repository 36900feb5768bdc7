/* The datagrams of a fleet with nothing around them: setpoints out, telemetry in. Linux.
 *
 *   bare_sockets FIRST_PORT SOCKETS RATE_HZ WARM_UP_S MEASURED_S < frames
 *
 * `frames` are the setpoints of the vehicles of one socket: for each a byte of length, then that many bytes.
 * Once a period every socket is read with recvmmsg until it is empty, and every frame leaves through every socket
 * with sendmmsg, a datagram each, to the address that the newest telemetry came from. One line when it has ended,
 * of the measured time: wall clock and processor time in s, datagrams sent and received.
 */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>

enum { BATCH = 256, LONGEST = 2048, SOCKETS_MOST = 64, BUFFER_BYTES = 4 << 20 };

static unsigned char room[BATCH][LONGEST], frames[BATCH][LONGEST];
static struct sockaddr_in from[BATCH], fleet[SOCKETS_MOST];
static struct iovec in_parts[BATCH], out_parts[BATCH];
static struct mmsghdr in[BATCH], out[BATCH];
static int ports[SOCKETS_MOST];

static double seconds(clockid_t clock) {
  struct timespec now;
  clock_gettime(clock, &now);
  return now.tv_sec + 1e-9 * now.tv_nsec;
}

static int bound(int port) {
  struct sockaddr_in own = {.sin_family = AF_INET, .sin_port = htons(port)};
  int opened = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0), bytes = BUFFER_BYTES;
  own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  setsockopt(opened, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof bytes);
  setsockopt(opened, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
  if (bind(opened, (struct sockaddr *)&own, sizeof own) != 0) {
    perror("bind");
    exit(1);
  }
  return opened;
}

static long receive(int at) {
  long received = 0;
  int count;
  do {
    for (int k = 0; k < BATCH; k++) in[k].msg_hdr.msg_namelen = sizeof from[k];
    count = recvmmsg(ports[at], in, BATCH, 0, NULL);
    if (count > 0) {
      received += count;
      fleet[at] = from[count - 1];
    }
  } while (count == BATCH);
  return received;
}

static long sent(int at, int many) {
  int done = 0;
  if (fleet[at].sin_port == 0) return 0;
  for (int k = 0; k < many; k++) out[k].msg_hdr.msg_name = &fleet[at];
  while (done < many) {
    int count = sendmmsg(ports[at], out + done, many - done, 0);
    if (count <= 0) break;
    done += count;
  }
  return done;
}

int main(int argc, char **argv) {
  if (argc != 6) return 2;
  int first = atoi(argv[1]), sockets = atoi(argv[2]), many = 0, length;
  double rate_hz = atof(argv[3]), warm_up_s = atof(argv[4]), measured_s = atof(argv[5]);
  while (many < BATCH && (length = getchar()) != EOF) {
    out_parts[many].iov_base = frames[many];
    out_parts[many].iov_len = fread(frames[many], 1, length, stdin);
    out[many].msg_hdr.msg_iov = &out_parts[many];
    out[many].msg_hdr.msg_iovlen = 1;
    out[many].msg_hdr.msg_namelen = sizeof fleet[0];
    many++;
  }
  for (int k = 0; k < BATCH; k++) {
    in_parts[k].iov_base = room[k];
    in_parts[k].iov_len = LONGEST;
    in[k].msg_hdr.msg_iov = &in_parts[k];
    in[k].msg_hdr.msg_iovlen = 1;
    in[k].msg_hdr.msg_name = &from[k];
  }
  for (int at = 0; at < sockets; at++) ports[at] = bound(first + at);

  double begin_s = seconds(CLOCK_MONOTONIC), began_s = 0, began_cpu_s = 0;
  long received = 0, left = 0;
  for (long turn = 1;; turn++) {
    double now_s = seconds(CLOCK_MONOTONIC);
    if (began_s == 0 && now_s >= begin_s + warm_up_s) {
      began_s = now_s;
      began_cpu_s = seconds(CLOCK_PROCESS_CPUTIME_ID);
      received = left = 0;
    }
    if (began_s > 0 && now_s >= began_s + measured_s) break;
    for (int at = 0; at < sockets; at++) received += receive(at);
    for (int at = 0; at < sockets; at++) left += sent(at, many);
    double next_s = begin_s + turn / rate_hz;
    struct timespec until = {.tv_sec = (time_t)next_s, .tv_nsec = (long)(1e9 * (next_s - (time_t)next_s))};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
  }
  printf("%f %f %ld %ld\n", seconds(CLOCK_MONOTONIC) - began_s, seconds(CLOCK_PROCESS_CPUTIME_ID) - began_cpu_s,
         left, received);
  return 0;
}
