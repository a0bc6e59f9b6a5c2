// What build.mjs has built before, as modules of their own.
declare module 'built:*' {
  const content: string | Uint8Array;
  export default content;
}
