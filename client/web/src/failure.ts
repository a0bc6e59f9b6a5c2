// failure.ts: what goes wrong, told in one line.

/** The peer broke proto/wire_format.md, or the package docs/scene_package.md: it makes no sense to ask it
 * again. */
export class ProtocolError extends Error {}

/** The server wants a token, or not this one. */
export class TokenError extends Error {}

/** This browser or page cannot do what the scene asks for. */
export class LimitError extends Error {}
