// SPDX-License-Identifier: MIT
// Foxglove's own client at a running bench: subscribes to everything that is advertised and, when the run ends,
// prints what it got as JSON. The first subscription to /step is given up and taken anew.
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const { WebSocket } = require("ws");

const seen = { counts: {}, schemas: {}, firsts: {}, lasts: {}, steps: [], messages: [], statuses: [], errors: [], protocol: "" };
const socket = new WebSocket(process.argv[2], [FoxgloveClient.SUPPORTED_SUBPROTOCOL]);
const client = new FoxgloveClient({ ws: socket });
const topics = new Map();
const decoder = new TextDecoder();
let stepChannel, stepSubscription, anew = false;

client.on("serverInfo", (info) => { seen.info = info; seen.protocol = socket.protocol; });
client.on("status", (status) => seen.statuses.push(status.message));
client.on("error", (error) => seen.errors.push(String(error)));
client.on("advertise", (channels) => {
  for (const channel of channels) {
    seen.schemas[channel.topic] = [channel.schemaName, channel.encoding, JSON.parse(channel.schema).type];
    const id = client.subscribe(channel.id);
    topics.set(id, channel.topic);
    if (channel.topic === "/step") { stepChannel = channel.id; stepSubscription = id; }
  }
  client.sendMessage(1, new Uint8Array([1, 2, 3]));  // Nobody publishes into a run.
  client.advertise({ topic: "/cmd_vel", encoding: "json", schemaName: "x" });
});
client.on("message", (message) => {
  const topic = topics.get(message.subscriptionId);
  const body = JSON.parse(decoder.decode(message.data));
  if (body.timestamp && BigInt(body.timestamp.sec) * 1000000000n + BigInt(body.timestamp.nsec) !== message.timestamp)
    seen.errors.push("the frame's time is not the message's: " + topic);
  seen.counts[topic] = (seen.counts[topic] || 0) + 1;
  if (!(topic in seen.firsts)) seen.firsts[topic] = body;
  seen.lasts[topic] = body;
  if (topic === "/messages") seen.messages.push(body.message);
  if (topic === "/step" && seen.steps.at(-1) !== body.phase) seen.steps.push(body.phase);
  if (topic === "/step" && !anew) {
    anew = true;
    client.unsubscribe(stepSubscription);
    topics.set(client.subscribe(stepChannel), "/step");
  }
});
client.on("close", () => { console.log(JSON.stringify(seen)); process.exit(0); });
setTimeout(() => { seen.errors.push("the run did not end"); console.log(JSON.stringify(seen)); process.exit(1); }, 120000);
