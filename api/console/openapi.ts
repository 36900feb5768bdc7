// Reads the API's OpenAPI document and writes it with its calls as one more schema, `Paths`, in the shape that
// openapi-fetch reads: of an API's paths, openapi-typescript writes mostly what each of them lacks.

import { text } from "node:stream/consumers";

type Schema = object;
type Contents = { content?: Record<string, { schema?: Schema }> };
type Parameter = { in: string; name: string; required?: boolean; schema: Schema };
type Operation = { parameters?: Parameter[]; requestBody?: Contents & { required?: boolean }; responses: Record<string, Contents> };
type Document = { paths: Record<string, Record<string, Operation>>; components: { schemas: Record<string, Schema> } };

const mapped = <T, U>(from: Record<string, T>, change: (value: T) => U): Record<string, U> =>
  Object.fromEntries(Object.entries(from).map(([name, value]) => [name, change(value)]));

const record = (properties: Record<string, Schema>, required = Object.keys(properties)): Schema => ({
  type: "object", properties, required, additionalProperties: false,
});

const contents = ({ content = {} }: Contents): Schema => record({ content: record(mapped(content, ({ schema = {} }) => schema)) });

/** Parameters by their place: path or query. */
function parameters(all: readonly Parameter[]): Schema {
  const isRequired = (each: Parameter): boolean => each.required ?? false;
  const inPlace = (place: string): Schema => {
    const here = all.filter((each) => each.in === place);
    return record(Object.fromEntries(here.map(({ name, schema }) => [name, schema])), here.filter(isRequired).map(({ name }) => name));
  };
  return record(Object.fromEntries(all.map((each) => [each.in, inPlace(each.in)])), [...new Set(all.filter(isRequired).map((each) => each.in))]);
}

/** Without errors: all have one shape, and the page shows its text. */
function operation({ parameters: all = [], requestBody, responses }: Operation): Schema {
  const successes = Object.entries(responses).filter(([status]) => status.startsWith("2"));
  const always = { parameters: parameters(all), responses: record(mapped(Object.fromEntries(successes), contents)) };
  if (requestBody === undefined) return record(always);
  return record({ ...always, requestBody: contents(requestBody) }, [...Object.keys(always), ...(requestBody.required ? ["requestBody"] : [])]);
}

type Properties = { properties?: Record<string, { default?: unknown }>; required?: string[] };

/** Titles only repeat the names, and examples are for readers of the API. What has a default is never absent. */
function plain(key: string, value: Properties | string | null): unknown {
  const isText = typeof value !== "object" || Array.isArray(value); // and no property of that name
  if (isText && ["title", "example", "examples"].includes(key)) return undefined;
  if (key === "description" && typeof value === "string") return value.replace(/\s+/g, " ");
  if (value === null || typeof value !== "object" || value.properties === undefined) return value;
  const given = Object.entries(value.properties).filter(([, each]) => each.default != null);
  for (const [, each] of given) delete each.default;
  return { ...value, required: [...new Set([...(value.required ?? []), ...given.map(([name]) => name)])] };
}

const { paths, components, ...rest }: Document = JSON.parse(await text(process.stdin), plain);
const schemas = { ...components.schemas, Paths: record(mapped(paths, (methods) => record(mapped(methods, operation)))) };
process.stdout.write(JSON.stringify({ ...rest, paths: {}, components: { schemas } }));
