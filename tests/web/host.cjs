// A page's side of web/worker.js in Node: gives it the messages of given.json, keeps what it sends.
const { Session } = require("./worker.cjs"), fs = require("fs");
const [live, messages] = JSON.parse(fs.readFileSync("given.json")), records = [], clouds = [], errors = [];
let ended;
const end = new Promise((resolve) => { ended = resolve; });
const session = new Session((message) => {
  if (message.got === "error") errors.push(message.message);
  if (message.got === "reset") records.length = 0;
  if (message.records) records.push(Buffer.from(message.records.buffer));
  if (message.got === "cloud") clouds.push({ ...message, errors: message.errors.map((one) => [...one]) });
  if (message.got === "toml") fs.writeFileSync("scenario.toml", message.text);
  if (message.got === "end") ended();
});
(async () => {
  await session.receive({ do: "load", live });
  for (const message of messages) {
    await session.receive(message);
    while (session.cloud) await new Promise((resume) => setTimeout(resume, 5));
  }
  await session.receive({ do: "run", speed: null });
  await end;
  await session.receive({ do: "toml" });
  fs.writeFileSync("records.bin", Buffer.concat(records));
  process.stdout.write(JSON.stringify({ clouds, errors }), () => process.exit(0));
})();
